# SPDX-License-Identifier: Apache-2.0
"""Thin plates get sheets without holes; sheets have no needless slivers."""

from __future__ import annotations

import manifold3d
import numpy as np
import pytest

from vega_planner.datatypes import Layer, Part
from vega_planner.layers import generate_layers
from vega_planner.settings import LayerSettings

TURNS = [
    (0.0, 0.0, 0.0),
    (45.0, 0.0, 0.0),
    (30.0, 20.0, 10.0),
    (35.0, 45.0, 15.0),
    (10.0, 50.0, 70.0),
]


def plate(thickness: float, turns: tuple[float, float, float]) -> Part:
    """A plate off the axes with nothing restrained."""
    mesh = manifold3d.Manifold.cube((24, 16, thickness)).rotate(turns).to_mesh64()
    vertices = np.array(np.asarray(mesh.vert_properties)[:, :3])
    vertices[:, 2] -= vertices[:, 2].min()
    faces = np.array(np.asarray(mesh.tri_verts), np.int64)
    return Part("plate", vertices, faces, np.zeros(len(faces), bool))


def first_sheet(part: Part) -> Layer:
    return generate_layers(part, LayerSettings(fill_core=False)).layers[0]


@pytest.mark.parametrize("thickness", [1.1, 1.2, 1.3])
@pytest.mark.parametrize("turns", TURNS)
def test_the_level_set_of_a_thin_plate_is_one_closed_surface(
    thickness: float, turns: tuple[float, float, float]
) -> None:
    layer = first_sheet(plate(thickness, turns))
    edges = np.sort(layer.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edges, uses = np.unique(edges, axis=0, return_counts=True)
    assert (uses == 2).all()
    assert len(layer.vertices) - len(edges) + len(layer.faces) == 2


def test_a_turned_plate_has_hardly_any_sliver() -> None:
    layer = first_sheet(plate(6.0, (30.0, 20.0, 10.0)))
    corners = layer.vertices[layer.faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(1)
    assert (2 * layer.face_areas < 0.008 * longest).mean() < 0.002
