# SPDX-License-Identifier: Apache-2.0
"""The room in front of a sheet is the radius of the ball between the fronts."""

from __future__ import annotations

import numpy as np
import pytest

from vega_planner.layers.core_kernels import NEARER, OPEN, OPPOSED, REGION
from vega_planner.layers.distance_field import DistanceField
from vega_planner.layers.front import measure_rooms
from vega_planner.layers.grid import depths_about, sample_part
from vega_planner.layers.grid_kernels import INSIDE
from vega_planner.progress import silent

from .shapes import Solid, box, part_of


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


def knobby():
    """A flat ball with bumps."""

    def bump(p):
        return p * (1 + 0.1 * np.sin(4 * p[:, :1]) * np.cos(5 * p[:, 1:2] + 3 * p[:, 2:]))

    return part_of(Solid.sphere(1, 80).warp_batch(bump).scale((14, 12, 4)))


def test_the_room_is_the_same_where_a_grid_tells_sooner_what_is_near():
    part = knobby()
    field = DistanceField.of_part(part)
    grid = sample_part(part, field, 0.5, silent)
    middles, inward = part.vertices[part.faces].mean(1), -part.face_normals
    feet = middles + 1e-6 * inward
    plain, kind = measure_rooms(field, None, feet, inward, 5.0)
    room, kind_again = measure_rooms(field, None, feet, inward, 5.0, grid=grid)
    both = np.isfinite(plain) & np.isfinite(room)
    assert both.sum() > 200
    assert (kind == kind_again).mean() > 0.98
    assert np.quantile(np.abs(room - plain)[both], 0.95) < NEARER * 5.0


def test_the_nodes_about_a_point_tell_its_depth():
    part = knobby()
    field = DistanceField.of_part(part)
    grid = sample_part(part, field, 0.5, silent)
    low, high = part.bounds
    points = np.random.default_rng(4).uniform(low, high, (20000, 3))
    depth = depths_about(grid, field, points)
    exact = field.distances(points)
    inner = (grid.state == INSIDE)[
        np.ravel_multi_index(
            np.rint((points - grid.origin) / grid.spacing).astype(np.int64).T, grid.shape
        )
    ]
    off = depth[inner] - exact[inner]
    assert inner.sum() > 5000
    assert off.min() > -1e-9
    assert (off < 1e-6).mean() > 0.999
