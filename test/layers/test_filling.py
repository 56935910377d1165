# SPDX-License-Identifier: Apache-2.0
"""What layers leave open is filled as far as it can be, and beads stay what they are."""

from __future__ import annotations

import numpy as np
import pytest
from manifold3d import Manifold as Solid

from vega_planner.layers import generate_layers
from vega_planner.layers.distance_field import DistanceField
from vega_planner.layers.filling import allow_for_facets
from vega_planner.settings import LayerSettings

from .shapes import base, box, part_of, sphere

SETTINGS = LayerSettings(thickness_mm=0.8)


def cup(wall: float) -> Solid:
    outside = Solid.cylinder(14, 9, 9, 96)
    return outside - Solid.cylinder(20, 9 - wall, 9 - wall, 96).translate((0, 0, wall))


def box_cup(wall: float) -> Solid:
    inside = Solid.cube((20 - 2 * wall, 14 - 2 * wall, 12)).translate((wall, wall, wall))
    return Solid.cube((20, 14, 10)) - inside


def angle(wall: float) -> Solid:
    return Solid.cube((20, 15, wall)) + Solid.cube((wall, 15, 20))


def tee(wall: float) -> Solid:
    return Solid.cube((20, 15, wall)) + Solid.cube((wall, 15, 18)).translate((8, 0, 0))


@pytest.mark.parametrize("restrain", [base, None], ids=["on its base", "all round"])
@pytest.mark.parametrize(
    ("vessel", "wall"),
    [(cup, wall) for wall in (0.6, 0.8, 1.0, 1.2, 2.0, 2.5, 3.0)]
    + [(box_cup, wall) for wall in (0.8, 1.0, 1.2, 1.5, 2.0, 2.5)]
    + [(angle, 1.2), (angle, 2.5), (tee, 1.2), (tee, 2.0)],
)
def test_a_part_with_thin_walls_is_filled_and_no_wall_is_laid_twice(vessel, wall, restrain):
    stack = generate_layers(part_of(vessel(wall), restrain), SETTINGS)
    assert stack.uncovered_ratio <= 0.005
    assert stack.overfill_ratio <= 0.02


@pytest.mark.parametrize("wall", [1.2, 2.0, 2.5])
def test_what_is_said_to_stay_open_does(wall):
    """Near the limit a few points tell too little: random ones find no more open."""
    part = part_of(tee(wall), base)
    stack = generate_layers(part, SETTINGS)
    points = np.random.default_rng(3).uniform([0, 0, 0], [20, 15, 18], (400000, 3))
    x, _, z = points.T
    points = points[(z < wall) | ((x > 8) & (x < 8 + wall))] + part.bounds[0]
    covered = np.zeros(len(points), bool)
    for sheet in stack.sheets:
        found = DistanceField(sheet.vertices, sheet.faces).nearest(points)
        half = sheet.thickness[sheet.faces].mean(1) / 2
        covered |= found.distances <= half[found.faces] + 1e-6
    assert 1 - covered.mean() <= 0.0052
    assert 1 - covered.mean() == pytest.approx(stack.uncovered_ratio, abs=8e-4)


def test_the_square_ends_of_a_thin_wall_are_covered():
    part = box(20, 0.8, 15)
    core = generate_layers(part, SETTINGS).cores[0]
    samples = np.random.default_rng(1).uniform([0, 0, 0], [20, 0.8, 15], (4000, 3))
    low, high = part.bounds
    points = low + samples * (high - low) / [20, 0.8, 15]
    edges = ((points - low < 0.4) | (high - points < 0.4)).sum(1) >= 2
    found = DistanceField(core.vertices, core.faces).nearest(points[edges])
    half = core.thickness[core.faces].mean(1)[found.faces] / 2
    assert (found.distances <= half).mean() > 0.99
    assert core.bead_thickness == pytest.approx(0.8, abs=1e-3)


def test_the_allowance_for_facets_changes_no_bead():
    sheet = generate_layers(sphere(6), SETTINGS).layers[0]
    thicker = allow_for_facets(sheet, 0.003)
    assert thicker.thickness == pytest.approx(sheet.thickness + 0.003)
    assert thicker.bead_thickness == pytest.approx(sheet.bead_thickness)


@pytest.mark.parametrize("height", [0.3, 0.5])
def test_a_plate_thinner_than_a_layer_is_one_sheet_half_way_to_its_base(height):
    stack = generate_layers(box(30, 20, height), SETTINGS)
    assert len(stack.layers) == 0
    (core,) = stack.cores
    assert np.median(core.vertices[:, 2]) == pytest.approx(height / 2, abs=1e-4)
    assert (core.vertices[:, 2] > 0.4 * height).all()
    assert core.bead_thickness.max() <= height + 1e-4
