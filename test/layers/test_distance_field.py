# SPDX-License-Identifier: Apache-2.0
"""Nearest points against brute force and another library."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from vega_planner.errors import InvalidInput
from vega_planner.layers.distance_field import DistanceField, distances_within


@settings(deadline=None, derandomize=True, max_examples=30)
@given(st.integers(0, 10**6), st.integers(1, 60))
def test_nearest_is_no_farther_than_any_sample(seed, count):
    """No point of any triangle is nearer, and the answer lies on the face it names."""
    rng = np.random.default_rng(seed)
    vertices = rng.normal(size=(3 * count, 3))
    faces = np.arange(3 * count).reshape(-1, 3)
    points = 2 * rng.normal(size=(20, 3))
    found = DistanceField(vertices, faces).nearest(points)
    assert found.distances == pytest.approx(np.linalg.norm(points - found.points, axis=1))
    weights = rng.dirichlet((1, 1, 1), 200)
    samples = np.einsum("wk,fkd->fwd", weights, vertices[faces]).reshape(-1, 3)
    every = np.linalg.norm(points[:, None] - samples[None], axis=2).min(1)
    assert (found.distances <= every + 1e-9).all()
    own = vertices[faces[found.faces]]
    barycentric = trimesh.triangles.points_to_barycentric(own, found.points)
    assert barycentric.min() > -1e-6


def test_distances_agree_with_trimesh():
    mesh = trimesh.creation.torus(10, 3, 24, 16)
    points = np.random.default_rng(3).uniform(-14, 14, (300, 3))
    _, expected, _ = trimesh.proximity.closest_point_naive(mesh, points)
    field = DistanceField(np.array(mesh.vertices), np.array(mesh.faces))
    assert field.distances(points) == pytest.approx(expected, abs=1e-9)


def test_segments_meet_the_first_face_in_their_way():
    mesh = trimesh.creation.box((2, 2, 2))
    field = DistanceField(np.array(mesh.vertices), np.array(mesh.faces))
    starts = np.array([[0.1, 0.2, 5.0], [5.0, 5.0, 5.0]])
    ends = np.array([[0.1, 0.2, -5.0], [6.0, 5.0, 5.0]])
    face, parameter = field.first_hits(starts, ends)
    assert mesh.face_normals[face[0]] == pytest.approx([0, 0, 1])
    assert parameter[0] == pytest.approx(0.4)
    assert face[1] == -1


def test_a_field_of_nothing_is_refused():
    with pytest.raises(InvalidInput):
        DistanceField(np.zeros((0, 3)), np.zeros((0, 3), np.int64))


@settings(deadline=None, derandomize=True, max_examples=30)
@given(st.integers(0, 10**6), st.floats(0.01, 3.0), st.floats(0.05, 20.0))
def test_distances_within_reach_are_the_distances(seed, reach, spread):
    rng = np.random.default_rng(seed)
    vertices = rng.uniform(-spread, spread, (90, 3))
    faces = np.arange(90).reshape(-1, 3)
    points = rng.uniform(-spread, spread, (25, 3))
    expected = DistanceField(vertices, faces).distances(points)
    found = distances_within(vertices, faces, points, reach)
    assert np.array_equal(found, np.where(expected < reach, expected, np.inf))


def test_nothing_is_within_reach_of_no_points_or_no_faces():
    corners, none = np.eye(3), np.zeros((0, 3))
    face = np.array([[0, 1, 2]])
    assert len(distances_within(corners, face, none, 1.0)) == 0
    assert np.isinf(distances_within(corners, none.astype(np.int64), corners, 1.0)).all()
