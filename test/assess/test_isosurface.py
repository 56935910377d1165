# SPDX-License-Identifier: Apache-2.0
"""The extracted surface is closed whatever the field, and lies where the field is zero."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from vega_planner.assess.field import Grid
from vega_planner.assess.isosurface import case_table, extract_surface


def volume(vertices, faces):
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6


@settings(deadline=None, derandomize=True, max_examples=25)
@given(st.integers(0, 2**31))
def test_surface_of_noise_is_closed_and_oriented(seed):
    field = np.full((9, 10, 11), 900, np.int16)
    inner = np.random.default_rng(seed).integers(-2000, 2000, (7, 8, 9))
    field[1:-1, 1:-1, 1:-1] = inner
    vertices, faces = extract_surface(field, Grid(np.zeros(3), 1.0, field.shape))
    sides = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    there = sides[:, 0] * len(vertices) + sides[:, 1]
    back = sides[:, 1] * len(vertices) + sides[:, 0]
    assert len(np.unique(there)) == len(there)
    assert np.array_equal(np.sort(there), np.sort(back))


def test_sphere_has_its_volume_to_second_order():
    errors = []
    for h in (0.4, 0.2):
        nodes = np.arange(-6, 6.01, h)
        z, y, x = np.meshgrid(nodes, nodes, nodes, indexing="ij")
        steps = (np.sqrt(x**2 + y**2 + z**2) - 5) / h * 2048
        field = np.clip(steps, -32767, 32767).astype(np.int16)
        mesh = extract_surface(field, Grid(np.full(3, -6.0), h, field.shape))
        errors.append(abs(volume(*mesh) / (4 / 3 * np.pi * 125) - 1))
    assert errors[1] < 0.002
    assert 3 < errors[0] / errors[1] < 5


def test_no_case_needs_more_than_five_triangles():
    counts, table = case_table()
    assert counts[0] == counts[255] == 0
    assert counts.max() == table.shape[1] == 5
