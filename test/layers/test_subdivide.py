# SPDX-License-Identifier: Apache-2.0
"""Splitting edges keeps the surface."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from vega_planner.layers.subdivide import mesh_edges, split_faces, split_long_edges


@settings(deadline=None, derandomize=True, max_examples=30)
@given(st.integers(0, 10**6))
def test_any_choice_of_edges_leaves_a_closed_mesh_of_the_same_area(seed):
    mesh = trimesh.creation.icosphere(1)
    edges, sides = mesh_edges(mesh.faces)
    marked = np.random.default_rng(seed).random(len(edges)) < 0.4
    middle = np.where(marked, len(mesh.vertices) + np.cumsum(marked) - 1, -1)[sides]
    vertices = np.concatenate([mesh.vertices, mesh.vertices[edges[marked]].mean(1)])
    split = trimesh.Trimesh(vertices, split_faces(mesh.faces, middle), process=False)
    assert split.is_watertight
    assert split.is_winding_consistent
    assert split.area == pytest.approx(mesh.area)


def test_no_edge_stays_longer_than_asked():
    mesh = trimesh.creation.box((10, 4, 1))
    vertices, faces = split_long_edges(np.array(mesh.vertices), np.array(mesh.faces), 0.9)
    edges, _ = mesh_edges(faces)
    assert np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1).max() <= 0.9
