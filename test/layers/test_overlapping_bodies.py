# SPDX-License-Identifier: Apache-2.0
"""Bodies that overlap or leave gaps narrower than the grid are filled, on their levels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vega_planner.datatypes import Part
from vega_planner.layers import generate_layers
from vega_planner.layers.contour import Sheet
from vega_planner.layers.core_kernels import OPPOSED
from vega_planner.layers.distance_field import DistanceField
from vega_planner.layers.front import measure_rooms
from vega_planner.layers.settle import _spans, settle_sheet
from vega_planner.settings import LayerSettings

from .shapes import Solid, base, box, part_of


def side_by_side(*solids: Solid) -> Part:
    """Bodies as they are, not united."""
    parts = [part_of(solid, base) for solid in solids]
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    return Part(
        "bodies",
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + first for part, first in zip(parts, starts)]),
        np.concatenate([part.restrained for part in parts]),
    )


def bearing(united: bool) -> Part:
    """A ring about a ring whose facets are turned: lenses of overlap and of gap."""
    outer = Solid.cylinder(4, 14, 14, 60) - Solid.cylinder(4, 10, 10, 60)
    inner = (Solid.cylinder(4, 10, 10, 60) - Solid.cylinder(4, 7.6, 7.6, 60)).rotate((0, 0, 3))
    return part_of(outer + inner, base) if united else side_by_side(outer, inner)


@pytest.mark.parametrize("united", [False, True])
def test_rings_fitted_into_each_other_are_filled(united: bool) -> None:
    stack = generate_layers(bearing(united), LayerSettings())
    field = DistanceField.of_part(stack.part)
    assert stack.uncovered_ratio < 0.008
    for layer in stack.layers:
        off = np.abs(field.distances(layer.vertices) - layer.depth_mm)
        assert off.max(initial=0) < 0.06


def test_the_wall_of_an_overlapping_body_beside_the_foot_ends_no_room() -> None:
    part = side_by_side(Solid.cube((20, 2, 15)), Solid.cube((20, 10, 15)).translate((0, -9.97, 0)))
    field = DistanceField.of_part(part)
    foot, inward = np.array([[10.0, 0.029, 7]]), np.array([[0.0, 1, 0]])
    room, kind = measure_rooms(field, None, foot, inward, 1.5, 0.36)
    assert kind.tolist() == [OPPOSED]
    assert room[0] == pytest.approx(0.985, abs=0.01)


def test_a_front_from_aside_is_met_where_its_ball_touches() -> None:
    part = box(20, 2, 15)
    field = DistanceField(part.vertices, part.faces)
    feet = np.array([[10.0, 0, 7], [0.5, 0, 7], [10, 0, 14.3]])
    aside = np.full(3, np.inf)
    measure_rooms(field, None, feet, np.tile([0.0, 1, 0], (3, 1)), 1.5, 0.36, aside=aside)
    assert np.isinf(aside[0])
    assert aside[1:] == pytest.approx([0.5, 0.7], abs=0.01)


def test_a_vertex_off_its_level_is_put_onto_it_and_one_without_a_level_goes() -> None:
    part = box(10, 10, 10)
    field = DistanceField(part.vertices, part.faces)
    points = np.array([[3.0, 3, 2], [7, 3, 2], [3, 7, 2], [7, 7, 2.3]])
    faces = np.array([[0, 2, 1], [1, 2, 3]])
    sheet = Sheet(
        2.0, points, faces, np.zeros(4, np.int64), np.zeros(4, bool), np.tile([0.0, 0, 1], (4, 1))
    )
    settled = settle_sheet(sheet, field, None)
    assert np.abs(field.distances(settled.vertices) - 2).max() < 1e-9
    assert len(settled.faces) == 2
    flat = box(10, 10, 1)
    deep = replace(sheet, vertices=points * [1, 1, 0.25])
    assert len(settle_sheet(deep, DistanceField(flat.vertices, flat.faces), None).faces) == 0


def test_a_hole_that_lost_faces_leave_is_spanned_and_the_rim_stays_open() -> None:
    part = box(10, 10, 10, None)
    steps = np.linspace(3.0, 7.0, 5)
    x, y = (grid.ravel() for grid in np.meshgrid(steps, steps, indexing="ij"))
    points = np.column_stack([x, y, np.full(25, 2.0)])
    corner = (np.arange(4)[:, None] * 5 + np.arange(4)).ravel()
    faces = np.concatenate(
        [
            np.column_stack([corner, corner + 5, corner + 1]),
            np.column_stack([corner + 1, corner + 5, corner + 6]),
        ]
    )
    rim = (np.abs(points[:, :2] - 5) == 2).any(1)
    sheet = Sheet(2.0, points, faces, np.zeros(25, np.int64), rim, np.tile([0.0, 0, 1], (25, 1)))
    left = faces[(faces != 12).all(1)]
    spans = _spans(points, left, sheet, DistanceField(part.vertices, part.faces))
    assert len(spans) == 4
    whole = np.concatenate([left, spans])
    area = np.cross(
        points[whole[:, 1]] - points[whole[:, 0]], points[whole[:, 2]] - points[whole[:, 0]]
    )
    assert area[:, 2].sum() / 2 == pytest.approx(16)
    assert (area[:, 2] > 0).all()
    off_level = points * [1, 1, 1.1]
    assert len(_spans(off_level, left, sheet, DistanceField(part.vertices, part.faces))) == 0
