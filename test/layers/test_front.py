# SPDX-License-Identifier: Apache-2.0
"""The room in front of a sheet is the radius of the ball between the fronts."""

from __future__ import annotations

import numpy as np
import pytest

from vega_planner.layers.core_kernels import OPEN, OPPOSED, REGION
from vega_planner.layers.distance_field import DistanceField
from vega_planner.layers.front import measure_rooms

from .shapes import Solid, box


def field_of(solid):
    mesh = solid.to_mesh64()
    return DistanceField(np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts))


@pytest.mark.parametrize("off", [0.0, 0.5, 0.9])
def test_the_room_between_eccentric_cylinders_is_that_of_the_ball_that_touches_both(off):
    outer, inner = 12.0, 10.0
    field = field_of(
        Solid.cylinder(40, outer, outer, 512)
        - Solid.cylinder(40, inner, inner, 512).translate((off, 0, 0))
    )
    # At the middle of the flat sides, where the normal is that of the circle.
    turn = (np.arange(512) + 0.5) * 2 * np.pi / 512
    out = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(512)])
    feet = outer * np.cos(np.pi / 512) * out + [0, 0, 20]
    room, kind = measure_rooms(field, None, feet, -out, 3.0)
    along = off * out[:, 0]
    exact = (outer**2 - inner**2 + off**2 - 2 * outer * along) / (2 * (outer + inner - along))
    assert (kind == OPPOSED).all()
    assert np.abs(room - exact).max() < 0.01


def test_there_is_room_up_to_the_other_side_and_none_is_measured_at_a_corner():
    part = box(20, 2, 15)
    field = DistanceField(part.vertices, part.faces)
    feet = np.array([[10.0, 0, 7], [0.5, 0, 7], [10, 0, 14.8]])
    room, kind = measure_rooms(field, None, feet, np.tile([0.0, 1, 0], (3, 1)), 1.5)
    assert room[0] == pytest.approx(1.0, abs=1e-4)
    assert kind.tolist() == [OPPOSED, OPEN, OPEN]
    assert np.isinf(room[1:]).all()


def test_before_the_restraint_region_the_whole_way_is_free():
    part = box(20, 15, 2)
    below = part.face_normals[:, 2] < -0.5
    field = DistanceField(part.vertices, part.faces[~below])
    region = DistanceField(part.vertices, part.faces[below])
    room, kind = measure_rooms(
        field, region, np.array([[10.0, 7, 2]]), np.array([[0.0, 0, -1]]), 3.0
    )
    assert kind.tolist() == [REGION]
    assert room[0] == pytest.approx(2.0, abs=1e-4)
