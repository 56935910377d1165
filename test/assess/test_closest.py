# SPDX-License-Identifier: Apache-2.0
"""Closest points and signed distances against brute force and known shapes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vega_planner.assess.closest import SurfaceDistance
from vega_planner.errors import InvalidInput

CUBE = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], float)
CUBE_FACES = np.array(
    [[0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6], [0, 1, 4], [1, 5, 4],
     [2, 6, 3], [3, 6, 7], [0, 4, 2], [2, 4, 6], [1, 3, 5], [3, 7, 5]]
)  # fmt: skip


def box_distance(points):
    away = np.maximum(np.maximum(-points, points - 1), 0)
    inside = np.minimum(points, 1 - points).min(1)
    return np.where(inside > 0, -inside, np.linalg.norm(away, axis=1))


@settings(deadline=None, derandomize=True, max_examples=30)
@given(st.integers(0, 2**31))
def test_distance_to_a_cube_is_exact_also_at_edges_and_corners(seed):
    points = np.random.default_rng(seed).uniform(-1, 2, (200, 3))
    found = SurfaceDistance(CUBE, CUBE_FACES).query(points)
    assert np.abs(found.signed - box_distance(points)).max() < 1e-12
    assert np.abs(np.linalg.norm(points - found.feet, axis=1) - np.abs(found.signed)).max() < 1e-12


def test_distances_agree_with_trying_every_triangle(small_dome):
    points = np.random.default_rng(3).uniform(-10, 10, (50, 3))
    found = SurfaceDistance(small_dome.vertices, small_dome.faces).query(points)
    for face in range(0, len(small_dome.faces), 1):
        single = SurfaceDistance(small_dome.vertices, small_dome.faces[[face]])
        assert (single.query(points, signed=False).signed >= np.abs(found.signed) - 1e-12).all()


def test_features_touch_marked_faces_at_their_shared_edges():
    surface = SurfaceDistance(CUBE, CUBE_FACES)
    top = np.isin(np.arange(12), [2, 3])
    found = surface.query(np.array([[0.5, 0.5, 1.5], [0.5, -0.5, 1.5], [0.5, -0.5, 0.5]]))
    assert surface.touching(top)[found.faces, found.features].tolist() == [True, True, False]


def test_mesh_without_faces_is_refused():
    with pytest.raises(InvalidInput, match="without faces"):
        SurfaceDistance(CUBE, np.zeros((0, 3), int))


def test_triangles_without_area_change_no_distance(ideal):
    block = ideal.block()
    flat = np.array([[0, 0, 1], [0, 1, 1], [0, 0, 0], [2, 2, 3]])
    points = np.random.default_rng(5).uniform(-4, 4, (500, 3))
    plain = SurfaceDistance(block.vertices, block.faces).query(points, signed=False)
    more = SurfaceDistance(block.vertices, np.concatenate([block.faces, flat]))
    assert more.query(points, signed=False).signed == pytest.approx(plain.signed, abs=1e-12)
