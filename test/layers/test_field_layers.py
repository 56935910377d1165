# SPDX-License-Identifier: Apache-2.0
"""The field engine against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from vega_planner.layers import generate_layers
from vega_planner.layers.distance_field import DistanceField
from vega_planner.settings import LayerSettings

from .shapes import box, dome, sphere

PARTS = {
    "box_top": lambda: box(40, 30, 12, "top"),
    "box_open": lambda: box(40, 30, 12, "open"),
    "dome": lambda: dome(15),
    "sphere": lambda: sphere(12),
}


def test_box_restrained_all_but_its_top_gives_flat_slices():
    part = box(40, 30, 12, "top")
    stack = generate_layers(part, LayerSettings(thickness_mm=0.8))
    assert len(stack.layers) == 15
    for k, layer in enumerate(stack.layers):
        assert np.abs(layer.vertices[:, 2] - (12 - 0.4 - 0.8 * k)).max() < 1e-3
        assert layer.area == pytest.approx(1200, abs=0.2)
        assert layer.face_normals[:, 2].min() > 0.999


@pytest.mark.parametrize("name", PARTS)
def test_vertices_lie_at_their_depth(name):
    part = PARTS[name]()
    field = DistanceField.of_part(part)
    for layer in generate_layers(part, LayerSettings()).layers:
        assert np.abs(field.distances(layer.vertices) - layer.depth_mm).max() < 0.1


@pytest.mark.parametrize("name", PARTS)
def test_rims_lie_on_the_restraint_region(name):
    part = PARTS[name]()
    for layer in generate_layers(part, LayerSettings()).layers:
        edges = np.sort(layer.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        edges, uses = np.unique(edges, axis=0, return_counts=True)
        assert uses.max() <= 2
        rim = np.unique(edges[uses == 1])
        if not part.restrained.any():
            assert len(rim) == 0
            continue
        region = DistanceField(part.vertices, part.faces[part.restrained])
        assert len(rim) > 0
        assert region.distances(layer.vertices[rim]).max() < 0.01


def test_layers_of_a_sphere_are_spheres():
    part = sphere(12, 5)
    stack = generate_layers(part, LayerSettings(thickness_mm=1.0))
    assert len(stack.layers) == 12
    for k, layer in enumerate(stack.layers[:-1]):
        radius = 11.5 - k
        assert layer.area == pytest.approx(4 * np.pi * radius**2, rel=0.05)
        outward = np.einsum("ij,ij->i", layer.vertex_normals, layer.vertices - [0, 0, 12])
        assert outward.min() > 0
