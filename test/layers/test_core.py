# SPDX-License-Identifier: Apache-2.0
"""What the last layers leave over is filled, and not twice."""

from __future__ import annotations

import numpy as np
import pytest

from vega_planner.layers import generate_layers
from vega_planner.layers.distance_field import DistanceField
from vega_planner.layers.leaving import next_from
from vega_planner.settings import LayerSettings

from .shapes import Solid, base, box, box_from_above, part_of

SETTINGS = LayerSettings(thickness_mm=0.8)


def covered_share(stack, count=40000):
    """Share of random points of a box that lie within half the thickness of a sheet."""
    low, high = stack.part.bounds
    points = np.random.default_rng(1).uniform(low, high, (count, 3))
    covered = np.zeros(count, bool)
    for sheet in stack.sheets:
        found = DistanceField(sheet.vertices, sheet.faces).nearest(points)
        local = sheet.thickness[sheet.faces].mean(1)[found.faces]
        covered |= found.distances <= local / 2 * 1.0001
    return covered.mean()


@pytest.mark.parametrize("thickness", [0.6, 0.8, 1.0, 1.2, 1.4, 1.7, 2.0, 2.4, 3.0])
def test_thin_walls_are_filled(thickness):
    stack = generate_layers(box(20, thickness, 15), SETTINGS)
    share = covered_share(stack)
    assert share > 0.985
    material = sum((s.face_areas * s.thickness[s.faces].mean(1)).sum() for s in stack.sheets)
    assert material / stack.part.volume - share < 0.025
    assert stack.uncovered_ratio == pytest.approx(1 - share, abs=0.02)


def test_a_wall_thinner_than_a_layer_gets_one_sheet_in_its_middle():
    stack = generate_layers(box(20, 0.6, 15), SETTINGS)
    assert len(stack.layers) == 0
    assert len(stack.cores) == 1
    core = stack.cores[0]
    assert np.abs(core.vertices[:, 1] - 0.3).max() < 1e-3
    assert core.bead_thickness == pytest.approx(0.6, abs=1e-3)
    assert core.area == pytest.approx(20 * 15, rel=0.06)


@pytest.mark.parametrize("height", [12.3, 12.5, 12.0, 11.7])
def test_the_last_slice_takes_the_height_that_is_left(height):
    stack = generate_layers(box_from_above(20, 15, height), SETTINGS)
    material = sum((s.face_areas * s.thickness[s.faces].mean(1)).sum() for s in stack.sheets)
    assert material == pytest.approx(stack.part.volume, rel=0.005)
    assert covered_share(stack) > 0.995
    for sheet in stack.sheets:
        assert (sheet.vertices[:, 2] - sheet.thickness / 2).min() > -0.01


def test_without_filling_only_envelopes_are_made():
    settings = LayerSettings(thickness_mm=0.8, fill_core=False)
    stack = generate_layers(box_from_above(20, 15, 12.5), settings)
    assert stack.cores == ()
    assert len(stack.layers) == 16


def test_no_layer_is_cut_inside_the_part():
    """In a channel the walls' fronts meet where the floor's still have room."""
    solid = Solid.cube((16, 24, 14)) - Solid.cube((18, 12, 14)).translate((-1, 6, 6))
    stack = generate_layers(part_of(solid, base), SETTINGS)
    for layer in stack.layers:
        edges = np.sort(layer.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        edges, uses = np.unique(edges, axis=0, return_counts=True)
        assert layer.vertices[edges[uses == 1], 2].max() < 1e-6
    material = sum((s.face_areas * s.thickness[s.faces].mean(1)).sum() for s in stack.sheets)
    inside = stack.part.volume
    assert material / inside < 1.03
    assert stack.uncovered_ratio < 0.006


@pytest.mark.parametrize("wall", [1.0, 1.2, 2.5])
def test_a_cup_of_thin_walls_keeps_its_thick_floor(wall):
    inside = 20 - 2 * wall
    solid = Solid.cube((20, 20, 14)) - Solid.cube((inside, inside, 14)).translate((wall, wall, 3))
    stack = generate_layers(part_of(solid, base, "cup"), SETTINGS)
    low, high = np.array([wall, wall, 0]), np.array([20 - wall, 20 - wall, 3])
    points = np.random.default_rng(2).uniform(low, high, (9000, 3)) + stack.part.bounds[0]
    covered = np.zeros(len(points), bool)
    material = 0.0
    for sheet in stack.sheets:
        found = DistanceField(sheet.vertices, sheet.faces).nearest(points)
        local = sheet.thickness[sheet.faces].mean(1)
        covered |= found.distances <= local[found.faces] / 2 * 1.0001
        material += float(sheet.face_areas @ local)
    assert covered.mean() > 0.99
    assert material / stack.part.volume == pytest.approx(1, abs=0.04)


def plate_with_holes() -> Solid:
    solid = Solid.cube((24, 18, 4))
    for x, y, radius in ((6, 5, 2.5), (16, 6, 2.8), (10, 13, 3.1)):
        solid -= Solid.cylinder(6, radius, radius, 32).translate((x, y, -1))
    return solid


def test_a_plate_five_layers_thick_keeps_two_from_each_side_and_gets_one_between_them():
    """Half of it is exactly the last layer's limit: no face may be filled by both ways."""
    stack = generate_layers(part_of(plate_with_holes()), SETTINGS)
    assert len(stack.layers) == 2
    middle = max(stack.cores, key=lambda core: core.area)
    assert np.median(middle.bead_thickness) == pytest.approx(0.8, abs=1e-3)
    assert np.median(np.abs(middle.vertices[:, 2] - 2.0)) < 1e-3
    assert stack.uncovered_ratio <= 0.005
    assert stack.overfill_ratio <= 0.01


def test_a_floor_two_and_a_half_layers_thick_is_filled_once():
    solid = Solid.cube((30, 30, 2))
    for k in range(3):
        solid += Solid.cube((2, 30, 8)).translate((3 + 11 * k, 0, 0))
        solid += Solid.cube((30, 2, 8)).translate((0, 3 + 11 * k, 0))
    stack = generate_layers(part_of(solid, base), SETTINGS)
    assert stack.uncovered_ratio <= 0.005
    assert stack.overfill_ratio <= 0.02


def test_the_limit_of_the_last_layer_keeps_off_the_gaps_that_most_faces_have():
    t = 1.0
    assert next_from(np.array([0.5]), np.array([1.0]), t) == 0.49  # a wall as thick as that
    gap, areas = np.array([0.1, 0.47, 0.486, 0.49, 0.494, 0.9]), np.array([5, 0.1, 1, 1, 1, 5.0])
    assert next_from(gap, areas, t) == 0.45
    assert next_from(gap[2:], areas[2:], t) == 0.47
    assert next_from(np.array([np.inf]), np.array([1.0]), t) == 0.49


def test_a_rod_with_a_thin_core_is_not_filled_as_a_wall():
    """Its fronts meet on a line: what is left there is round, and laid once."""
    rod = part_of(Solid.cylinder(30, 3.17, 3.17, 24), base)
    stack = generate_layers(rod, LayerSettings(thickness_mm=1.2))
    assert stack.uncovered_ratio <= 0.005
    assert stack.overfill_ratio <= 0.02
