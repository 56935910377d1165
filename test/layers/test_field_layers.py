# SPDX-License-Identifier: Apache-2.0
"""The field engine against closed forms and exact distances."""

from __future__ import annotations

import numpy as np
import pytest

from vega_planner.datatypes import Part
from vega_planner.errors import BadRestraint, Cancelled
from vega_planner.layers import generate_layers
from vega_planner.layers.distance_field import DistanceField
from vega_planner.settings import LayerSettings

from .shapes import Solid, box, box_from_above, dome, part_of, slotted, sphere

SETTINGS = LayerSettings(thickness_mm=0.8)
PARTS = {
    "box_from_above": lambda: box_from_above(20, 15, 12),
    "box": lambda: box(20, 15, 8),
    "dome": lambda: dome(9),
    "sphere": lambda: sphere(8),
}


@pytest.fixture(scope="module", params=PARTS)
def stack(request):
    return generate_layers(PARTS[request.param](), SETTINGS)


def rim_of(layer):
    edges = np.sort(layer.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edges, uses = np.unique(edges, axis=0, return_counts=True)
    assert uses.max() <= 2
    return np.unique(edges[uses == 1])


def test_box_restrained_all_but_its_top_gives_flat_slices():
    stack = generate_layers(box_from_above(40, 30, 12), SETTINGS)
    assert len(stack.layers) == 15
    for k, layer in enumerate(stack.layers):
        assert np.abs(layer.vertices[:, 2] - (12 - 0.4 - 0.8 * k)).max() < 1e-3
        assert layer.area == pytest.approx(1200, abs=0.1)
        assert layer.face_normals[:, 2].min() > 0.999


@pytest.mark.parametrize("spacing", [0.7, 1.5])
def test_round_walls_and_small_triangles_leave_slices_flat_up_to_the_rim(spacing):
    """The rim of the first slice is found from nodes beyond the wall, aslant of the top."""
    solid = Solid.cylinder(4, 9, 9, 72) - Solid.cylinder(9, 5, 5, 48).translate((6, 6, -2))
    part = part_of(solid.refine_to_length(spacing), lambda n, c: n[:, 2] < 0.5)
    section = part.face_areas[~part.restrained].sum()
    for layer in generate_layers(part, SETTINGS).layers:
        assert np.abs(layer.vertices[:, 2] - (4 - layer.depth_mm)).max() < 1e-3
        assert layer.area == pytest.approx(section, rel=2e-3)


def test_points_of_a_layer_lie_at_its_depth(stack):
    field = DistanceField.of_part(stack.part)
    errors = []
    for layer in stack.layers:
        at_vertices = np.abs(field.distances(layer.vertices) - layer.depth_mm)
        at_centres = np.abs(field.distances(layer.vertices[layer.faces].mean(1)) - layer.depth_mm)
        assert at_vertices.max() < 0.1
        assert at_centres.max() < 0.25
        errors += [at_vertices, at_centres]
    assert np.quantile(np.concatenate(errors), 0.99) < 0.02


def test_layers_are_numbered_by_depth(stack):
    for k, layer in enumerate(stack.layers):
        assert layer.index == k
        assert layer.depth_mm == pytest.approx((k + 0.5) * 0.8)


def test_rims_lie_on_the_restraint_region(stack):
    part = stack.part
    for layer in stack.layers:
        rim = rim_of(layer)
        if not part.restrained.any():
            assert len(rim) == 0
            continue
        region = DistanceField(part.vertices, part.faces[part.restrained])
        assert region.distances(layer.vertices[rim]).max() < 0.01


def test_normals_point_away_from_the_core(stack):
    field = DistanceField.of_part(stack.part)
    for layer in stack.layers[:-1]:
        centres = layer.vertices[layer.faces].mean(1)
        toward_surface = field.nearest(centres).points - centres
        along = (layer.face_normals * toward_surface).sum(1)
        assert (layer.face_areas[along < 0]).sum() < 0.01 * layer.area


def test_layers_of_a_sphere_are_spheres():
    stack = generate_layers(sphere(10, 128), LayerSettings(thickness_mm=1.0))
    assert len(stack.layers) == 10
    for k, layer in enumerate(stack.layers[:-1]):
        assert layer.area == pytest.approx(4 * np.pi * (9.5 - k) ** 2, rel=0.03)


def test_layers_a_third_as_thick_have_levels_in_common():
    """The middle one of three thin layers lies where the middle of a thick one does."""
    part = dome(9)
    coarse = generate_layers(part, LayerSettings(thickness_mm=1.2)).layers
    fine = generate_layers(part, LayerSettings(thickness_mm=0.4)).layers
    for k, layer in enumerate(coarse[:-1]):
        same = fine[3 * k + 1]
        assert same.depth_mm == pytest.approx(layer.depth_mm)
        apart = DistanceField(same.vertices, same.faces).distances(layer.vertices)
        assert np.quantile(apart, 0.99) < 0.03


def test_moving_the_part_moves_no_layer():
    solid = Solid.cylinder(9, 6, 5, 48) + Solid.cube((4, 14, 6))
    here = part_of(solid, lambda n, c: n[:, 2] < -0.99)
    shift = np.array([0.137, 0.211, 0.0])
    there = Part(here.name, here.vertices + shift, here.faces, here.restrained)
    a, b = (generate_layers(part, SETTINGS).layers for part in (here, there))
    assert len(a) == len(b)
    for first, second in zip(a, b):
        apart = DistanceField(second.vertices - shift, second.faces).distances(first.vertices)
        assert np.quantile(apart, 0.99) < 0.02


def test_the_same_part_gives_the_same_bytes():
    first, second = (generate_layers(dome(6), SETTINGS) for _ in range(2))
    for a, b in zip(first.sheets, second.sheets, strict=True):
        assert a.vertices.tobytes() == b.vertices.tobytes()
        assert a.faces.tobytes() == b.faces.tobytes()
        assert a.thickness.tobytes() == b.thickness.tobytes()


@pytest.mark.parametrize("gap", [2.0, 0.6])
def test_layers_go_round_a_slot(gap):
    """Right of the slot the distance is that round its lower corners, in closed form."""
    stack = generate_layers(slotted(gap), SETTINGS)
    assert len(stack.layers) == 38
    assert "of the volume" in stack.warnings[0]
    left, right = 12 - gap / 2, 12 + gap / 2
    for layer in stack.layers:
        centres = layer.vertices[layer.faces].mean(1)
        assert not ((np.abs(centres[:, 1] - 12) < gap / 2 - 0.01) & (centres[:, 2] > 6.01)).any()
        y, z = layer.vertices[:, 1], layer.vertices[:, 2]
        behind = (y > right - 1e-6) & (z > 6)
        distance = np.where(behind, right + np.hypot(y - right, z - 6), y)
        ahead = (y < left + 1e-3) | behind | (z < 6)
        assert np.quantile(np.abs(distance - layer.depth_mm)[ahead], 0.98) < 0.1


def test_a_fully_restrained_part_is_refused():
    part = box(10, 10, 10, lambda n, c: np.ones(len(n), bool))
    with pytest.raises(BadRestraint):
        generate_layers(part, SETTINGS)


def test_generation_can_be_cancelled():
    def stop(progress):
        raise Cancelled("stop")

    with pytest.raises(Cancelled):
        generate_layers(dome(6), SETTINGS, stop)
