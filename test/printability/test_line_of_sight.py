# SPDX-License-Identifier: Apache-2.0
"""The line test against every triangle in turn, and in the paper's cases."""

from __future__ import annotations

import numpy as np
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from vega_planner.datatypes import TriangleGeometry
from vega_planner.printability.line_of_sight import Occluder


class Mesh(TriangleGeometry):
    def __init__(self, vertices, faces):
        self.vertices, self.faces = np.array(vertices, float), np.array(faces)
        self._freeze_mesh()


def every_triangle(mesh, origins, directions):
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    hit = np.zeros(len(origins), bool)
    for k, (o, d) in enumerate(zip(origins, directions)):
        p = np.cross(d, c - a)
        det = np.einsum("ij,ij->i", b - a, p)
        with np.errstate(all="ignore"):
            u = np.einsum("ij,ij->i", o - a, p) / det
            q = np.cross(o - a, b - a)
            v = np.einsum("j,ij->i", d, q) / det
            t = np.einsum("ij,ij->i", c - a, q) / det
        hit[k] = ((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)).any()
    return hit


@settings(deadline=None, derandomize=True, max_examples=25)
@given(st.integers(0, 10**6), st.integers(1, 60))
def test_the_tree_finds_what_every_triangle_finds(seed, count):
    rng = np.random.default_rng(seed)
    mesh = Mesh(rng.uniform(-5, 5, (3 * count, 3)), np.arange(3 * count).reshape(-1, 3))
    origins = rng.uniform(-6, 6, (80, 3))
    directions = rng.normal(size=(80, 3))
    directions[:10] = np.eye(3)[rng.integers(0, 3, 10)]  # along the axes of the boxes
    found = Occluder(mesh).blocks(origins, directions, 0.0)
    assert (found == every_triangle(mesh, origins, directions)).all()


def test_a_convex_shell_hides_nothing_from_outside_and_everything_from_inside():
    ball = trimesh.creation.icosphere(4, radius=10)
    mesh = Mesh(ball.vertices, ball.faces)
    normals = mesh.vertex_normals
    assert not Occluder(mesh).blocks(mesh.vertices, normals).any()
    assert Occluder(mesh).blocks(mesh.vertices, -normals, 0.05).all()


def test_no_mesh_hides_nothing():
    mesh = Mesh(np.zeros((0, 3)), np.zeros((0, 3), int))
    assert not Occluder(mesh).blocks(np.zeros((2, 3)), np.ones((2, 3))).any()
