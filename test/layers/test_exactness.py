# SPDX-License-Identifier: Apache-2.0
"""Layers of parts turned any way stay inside the part, on their level and on the region."""

from __future__ import annotations

import manifold3d
import numpy as np
import pytest
import trimesh

from vega_planner.datatypes import Part
from vega_planner.layers import generate_layers
from vega_planner.layers.distance_field import DistanceField
from vega_planner.settings import LayerSettings

from .shapes import base, part_of

Solid = manifold3d.Manifold


def turned(solid: Solid, angles) -> Part:
    """Restrain the base of a solid, then turn the part."""
    part = part_of(solid, base)
    turn = trimesh.transformations.euler_matrix(*np.radians(angles))
    vertices = trimesh.transform_points(part.vertices, turn)
    vertices[:, 2] -= vertices[:, 2].min()
    return Part("turned", vertices, part.faces, part.restrained)


def gear() -> Solid:
    solid = Solid.cylinder(8, 13, 13, 128)
    for k in range(12):
        solid += Solid.cube((5, 2.5, 8)).translate((12, -1.25, 0)).rotate((0, 0, 30 * k))
    return (solid - Solid.cylinder(9, 4, 4, 48).translate((0, 0, -0.5))).scale((1.5, 1.5, 1.5))


def tray(wall: float) -> Solid:
    hollow = Solid.cube((20 - 2 * wall, 14 - 2 * wall, 12)).translate((wall, wall, wall))
    return Solid.cube((20, 14, 9)) - hollow


def angle() -> Solid:
    return Solid.cube((24, 16, 6)) + Solid.cube((6, 16, 22))


def depths(stack) -> tuple[np.ndarray, np.ndarray]:
    """|distance to S - r| at vertices and at face centres."""
    field = DistanceField.of_part(stack.part)
    at = ([], [])
    for layer in stack.layers:
        for points, off in zip((layer.vertices, layer.vertices[layer.faces].mean(1)), at):
            off.append(np.abs(field.distances(points) - layer.depth_mm))
    return tuple(np.concatenate(off) for off in at)


@pytest.mark.parametrize(
    ("solid", "angles", "t"),
    [
        (gear, (37.0, 55.8, 148.9), 2.0),
        (angle, (-119.9, -37.6, 147.7), 0.4),
    ],
)
def test_no_vertex_leaves_a_turned_part(solid, angles, t):
    part = turned(solid(), angles)
    whole = DistanceField(part.vertices, part.faces)
    for layer in generate_layers(part, LayerSettings(thickness_mm=t)).layers:
        found = whole.nearest(layer.vertices)
        away = layer.vertices - found.points
        out = (away * whole.normals(found.faces)).sum(1) > 0.9 * found.distances
        assert found.distances[out].max(initial=0.0) < 0.01


def test_the_rim_follows_the_wall_where_a_level_lies_just_above_the_region():
    """A floor of 2.4 mm and a level at 2.2: the sheet is 0.2 mm above the region."""
    part = turned(tray(2.4), (169.4, -154.3, 101.3))
    stack = generate_layers(part, LayerSettings(thickness_mm=0.4))
    assert len(stack.layers) == 6
    at_vertices, _ = depths(stack)
    assert at_vertices.max() < 0.1


def test_small_parts_are_sampled_closer_until_their_layers_are_on_their_level():
    """Walls exactly as thick as a layer, whose joint with the floor no coarse grid sees."""
    stack = generate_layers(part_of(tray(0.8), base), LayerSettings(thickness_mm=0.8))
    off = np.concatenate([np.zeros(1), *depths(stack)]) if stack.layers else np.zeros(1)
    assert np.quantile(off, 0.99) < 0.02
    assert stack.uncovered_ratio < 0.005
    assert stack.overfill_ratio < 0.02


def impeller() -> Solid:
    solid = Solid.cylinder(4, 20, 20, 96) + Solid.cylinder(15, 5, 5, 64)
    blade = Solid.cube((15, 2.2, 10)).translate((4, -1.1, 3))
    for k in range(7):
        solid += blade.rotate((0, 0, 360 * k / 7))
    return solid


def test_where_an_edge_is_divided_beside_the_region_it_stays_inside():
    """A crease between two fronts may leave the part where it meets the region."""
    stack = generate_layers(part_of(impeller(), base), LayerSettings(thickness_mm=0.8))
    lowest = min(layer.vertices[:, 2].min() for layer in stack.layers)
    assert lowest > -1e-3
