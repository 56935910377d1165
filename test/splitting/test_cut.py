# SPDX-License-Identifier: Apache-2.0
"""The exact cut: areas, shared vertices, orientation."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from vega_planner.datatypes import Patch, face_cross
from vega_planner.splitting.bands import bands
from vega_planner.splitting.cut import cut_mesh

BALL = trimesh.creation.icosphere(3, radius=10.0)
V, F = np.array(BALL.vertices), np.array(BALL.faces)


def areas(vertices, faces):
    return 0.5 * np.linalg.norm(face_cross(vertices, faces), axis=1)


@settings(deadline=None, derandomize=True, max_examples=50)
@given(st.integers(0, 10**6), st.floats(0.2, 3.0), st.floats(-1, 1))
def test_area_is_conserved_and_the_pieces_fit(seed, wave, level):
    direction = np.random.default_rng(seed).normal(size=3)
    field = np.sin(V @ direction / np.linalg.norm(direction) / wave) + level
    cut = cut_mesh(V, F, field)
    whole = areas(V, F).sum()
    assert abs(areas(cut.vertices, cut.faces).sum() / whole - 1) < 1e-9
    # shared cut vertices: the pieces together are as closed as the ball
    edges = np.sort(cut.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    _, count = np.unique(edges, axis=0, return_counts=True)
    assert (count == 2).all()


@settings(deadline=None, derandomize=True, max_examples=30)
@given(st.floats(-9, 9))
def test_pieces_lie_on_their_side_and_keep_their_orientation(height):
    cut = cut_mesh(V, F, V[:, 2] - height)
    z = cut.vertices[cut.faces][:, :, 2]
    slack = 0.02 * 2.0  # snapped vertices stay where they are
    assert z[cut.positive].min(initial=20) >= height - slack
    assert z[~cut.positive].max(initial=-20) <= height + slack
    normal = face_cross(cut.vertices, cut.faces)
    assert (np.einsum("ij,ij->i", normal, face_cross(V, F)[cut.source]) > 0).all()


def test_zeros_at_vertices_make_no_slivers():
    field = V[:, 2].copy()
    field[np.abs(field) < 1e-9] = 0.0
    cut = cut_mesh(V, F, field)
    assert areas(cut.vertices, cut.faces).min() > 1e-3


def test_linear_fields_are_carried_exactly():
    cut = cut_mesh(V, F, V[:, 0] - 1.234)
    assert np.abs(cut.carry(V) - cut.vertices).max() < 1e-12


def test_bands_add_up_and_stay_within_their_heights():
    patch = Patch(0, V, F, np.full(len(V), 0.8), np.tile([0, 0, 1.0], (len(V), 1)))
    pieces = bands(patch, [-5.0, 0.3, 6.0])
    assert len(pieces) == 4
    assert sum(piece.area for piece in pieces) == pytest.approx(patch.area, rel=1e-9)
    tops = [piece.vertices[:, 2].max() for piece in pieces]
    assert np.allclose(tops, [-5.0, 0.3, 6.0, 10.0], atol=0.05)
