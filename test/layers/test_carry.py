# SPDX-License-Identifier: Apache-2.0
"""The sheet of a thin wall turns the wall's corners at the same depth."""

from __future__ import annotations

import numpy as np
import pytest
from manifold3d import Manifold as Solid

from vega_planner.datatypes import Layer, LayerStack
from vega_planner.layers import generate_layers
from vega_planner.layers.distance_field import DistanceField
from vega_planner.settings import LayerSettings

from .shapes import base, part_of

SETTINGS = LayerSettings(thickness_mm=0.8)
WALL = 2.0


@pytest.fixture(scope="module")
def tray() -> LayerStack:
    inside = Solid.cube((20 - 2 * WALL, 14 - 2 * WALL, 12)).translate((WALL, WALL, WALL))
    return generate_layers(part_of(Solid.cube((20, 14, 10)) - inside, base), SETTINGS)


def at_wall_height(stack: LayerStack) -> tuple[Layer, np.ndarray]:
    """The sheet along the outside of the wall, and its vertices half-way up."""
    (sheet,) = [s for s in stack.sheets if s.depth_mm == pytest.approx(WALL / 4, abs=0.01)]
    x, y, z = sheet.vertices.T
    outer = np.minimum.reduce([x, 20 - x, y, 14 - y]) < WALL / 2
    return sheet, np.flatnonzero(outer & (z > 4) & (z < 8))


def test_the_outer_sheet_keeps_a_quarter_of_the_wall_or_more_at_its_corners(tray):
    sheet, rows = at_wall_height(tray)
    x, y, _ = sheet.vertices[rows].T
    depth = np.minimum.reduce([x, 20 - x, y, 14 - y])
    # Between the corner and the fan round the inner corner, the part is deeper than the wall.
    assert depth.min() == pytest.approx(WALL / 4, abs=2e-3)
    assert depth.max() <= WALL / (1 + np.sqrt(0.5)) / 2 + 5e-3


def test_there_it_is_as_thick_as_the_wall_has_room(tray):
    sheet, rows = at_wall_height(tray)
    x, y, _ = sheet.vertices[rows].T
    depth = np.minimum.reduce([x, 20 - x, y, 14 - y])
    assert sheet.bead_thickness[rows] == pytest.approx(2 * depth, abs=0.05)


def test_a_tray_is_filled_and_not_laid_twice(tray):
    rng = np.random.default_rng(3)
    points = rng.uniform([0, 0, 0], [20, 14, 10], (60000, 3))
    hollow = ((points > WALL) & (points < [20 - WALL, 14 - WALL, 12])).all(1)
    points = points[~hollow]
    covered, material = np.zeros(len(points), bool), 0.0
    for sheet in tray.sheets:
        thickness = sheet.thickness[sheet.faces].mean(1)
        material += float((sheet.face_areas * thickness).sum())
        found = DistanceField(sheet.vertices, sheet.faces).nearest(points)
        covered |= found.distances <= thickness[found.faces] / 2 + 1e-6
    assert 1 - covered.mean() <= 0.005
    assert material / tray.part.volume - covered.mean() <= 0.02
