# SPDX-License-Identifier: Apache-2.0
"""Voxel kernels against scipy, brute force and volumes known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from vega_planner.printability import grid_kernels as kernels
from vega_planner.printability.material import EMPTY, Material, grid_for, mesh_field

from .envelopes import dome


@settings(deadline=None, derandomize=True, max_examples=30)
@given(st.integers(0, 10**6), st.tuples(*[st.integers(1, 14)] * 3), st.floats(0.001, 0.6))
def test_distances_equal_those_of_scipy(seed, shape, share):
    solid = np.random.default_rng(seed).random(shape) < share
    out = np.empty(shape, np.float32)
    kernels.distance_to(solid, 0.7, out)
    if solid.any():
        expected = 0.7 * ndimage.distance_transform_edt(~solid)
        assert np.abs(out - expected).max() < 1e-4
    else:
        assert (out >= 1e5).all()


@settings(deadline=None, derandomize=True, max_examples=20)
@given(st.integers(0, 10**6), st.integers(1, 12))
def test_every_voxel_takes_a_nearest_label(seed, count):
    rng = np.random.default_rng(seed)
    label = np.full((7, 9, 8), -1, np.int32)
    where = rng.integers(0, [7, 9, 8], (count, 3))
    for number, (i, j, k) in enumerate(where):
        label[i, j, k] = number
    seeds = {int(n): p for n, p in zip(label[tuple(where.T)], where)}
    kernels.nearest_label(label)
    for i, j, k in np.ndindex(label.shape):
        squares = {n: ((p - [i, j, k]) ** 2).sum() for n, p in seeds.items()}
        assert squares[int(label[i, j, k])] == min(squares.values())


@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_filled_volume_is_the_solid_s_volume(turn):
    mesh = trimesh.creation.box((20, 14, 9))
    mesh.apply_transform(trimesh.transformations.rotation_matrix(turn, [1, 2, 3]))
    v, f = np.array(mesh.vertices), np.array(mesh.faces)
    origin, spacing, shape = grid_for(v.min(0), v.max(0), 0.3)
    solid = np.zeros(shape, bool)
    kernels.fill_mesh(v, f, origin, spacing, solid)
    assert abs(solid.sum() * spacing**3 / (20 * 14 * 9) - 1) < 0.03
    index = np.argwhere(solid)
    inside = origin + spacing * index
    assert trimesh.Trimesh(v, f).bounding_box.extents.min() > 0
    local = (
        np.linalg.inv(trimesh.transformations.rotation_matrix(turn, [1, 2, 3]))[:3, :3] @ inside.T
    )
    assert (np.abs(local.T) <= np.array([10, 7, 4.5]) + 1e-9).all()


def test_columns_along_shared_edges_are_filled_once():
    mesh = trimesh.creation.box((8, 8, 8))  # origin on the grid: columns hit edges exactly
    v, f = np.array(mesh.vertices), np.array(mesh.faces)
    solid = np.zeros((17, 17, 17), bool)
    kernels.fill_mesh(v, f, np.full(3, -8.0), 1.0, solid)
    assert solid.sum() == 8 * 8 * 8


def test_each_layer_owns_its_own_shell():
    stack = dome()
    material = Material(stack.part, stack.sheets, 0.5)
    index = np.argwhere(material.solid)
    points = material.origin + material.spacing * index
    owner = np.searchsorted(material.first, material.face[tuple(index.T)], side="right") - 1
    depth = 12.0 - np.linalg.norm(points, axis=1)
    expected = np.clip(np.floor(depth / 0.8), 0, len(stack.sheets) - 1)
    wrong = np.abs(owner - expected)
    assert (wrong <= 1).all()
    assert (wrong == 0).mean() > 0.7


@settings(deadline=None, derandomize=True, max_examples=25)
@given(st.integers(0, 10**6), st.floats(0.02, 1.0))
def test_a_face_leaves_no_hole_in_the_voxels_it_passes(seed, width):
    rng = np.random.default_rng(seed)
    way = rng.normal(size=3)
    side = np.cross(way, rng.normal(size=3))
    tip = 12.0 + 3.0 * rng.normal(size=3)
    base = tip + 20.0 * way / np.linalg.norm(way)
    side *= 0.5 * width / np.linalg.norm(side)
    corners = np.roll(np.array([tip, base - side, base + side]), rng.integers(3), axis=0)
    label = np.full((48, 48, 48), -1, np.int32)
    best = np.full(label.shape, 9.0, np.float32)
    origin = np.full(3, -12.0)
    kernels.stamp_faces(corners, np.array([[0, 1, 2]]), origin, 1.0, 7, label, best)
    weights = rng.dirichlet(np.ones(3), 300)
    at = np.rint(weights @ corners - origin).astype(int)
    for i, j, k in at[((at > 0) & (at < 47)).all(1)]:
        assert (label[i - 1 : i + 2, j - 1 : j + 2, k - 1 : k + 2] == 7).any()
    stamped = np.argwhere(label == 7) + origin
    foot = trimesh.triangles.closest_point(np.tile(corners, (len(stamped), 1, 1)), stamped)
    assert np.linalg.norm(stamped - foot, axis=1).max(initial=0.0) <= 0.5 * np.sqrt(3) + 1e-6


def test_field_beyond_its_grid_is_a_lower_bound_and_close():
    ball = trimesh.creation.icosphere(3, radius=5.0)
    field = mesh_field(_Mesh(ball), 0.4)
    rng = np.random.default_rng(0)
    points = rng.normal(size=(500, 3))
    points *= (rng.uniform(5.5, 40, 500) / np.linalg.norm(points, axis=1))[:, None]
    true = np.linalg.norm(points, axis=1) - 5.0
    found = field.distance(points)
    assert (found <= true + 0.45).all()
    assert (found >= 0.5 * true - 0.5).all()


def test_nothing_is_far_from_everything():
    assert EMPTY.distance(np.zeros((1, 3)))[0] > 100


class _Mesh:
    def __init__(self, mesh: trimesh.Trimesh) -> None:
        self.vertices = np.array(mesh.vertices)
        self.faces = np.array(mesh.faces)
