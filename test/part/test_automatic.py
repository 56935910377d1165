# SPDX-License-Identifier: Apache-2.0
"""The automatic restraint region: the base a part rests on, with reasons, or none."""

from __future__ import annotations

import manifold3d
import numpy as np
import pytest

from vega_planner.part import load_part
from vega_planner.part.automatic import ENOUGH, propose_restraint, rank_planes
from vega_planner.settings import PartSettings

AUTO = PartSettings(brr=("auto",))


def part_of(solid):
    mesh = solid.to_mesh64()
    return load_part(
        (np.array(mesh.vert_properties)[:, :3], np.array(mesh.tri_verts).astype(np.int64)), AUTO
    )


def explanation(part):
    lines = [line for line in part.warnings if line.startswith("restraint auto: ")]
    assert len(lines) == 1
    return lines[0]


def test_a_dome_is_restrained_at_its_base_and_the_reason_given():
    part = part_of(manifold3d.Manifold.sphere(15.0, 64).trim_by_plane([0, 0, 1], 0.0))
    assert (part.restrained == (part.face_normals[:, 2] < -0.999)).all()
    assert "flat base" in explanation(part) and "rests on it" in explanation(part)


def test_the_top_and_the_sides_of_a_block_rank_below_its_base_and_are_passed_over():
    part = part_of(manifold3d.Manifold.cube([40.0, 30.0, 12.0]))
    planes = rank_planes(part)
    assert len(planes) == 6
    assert [plane.score >= ENOUGH for plane in planes] == [True] + [False] * 5
    np.testing.assert_allclose(planes[0].normal, [0, 0, -1], atol=1e-12)
    np.testing.assert_allclose(planes[-1].normal, [0, 0, 1], atol=1e-12)
    assert "passed over" in explanation(part)
    assert sum(plane.area_mm2 for plane in planes) == pytest.approx(part.area)


@pytest.mark.parametrize(
    "solid",
    [
        manifold3d.Manifold.sphere(15.0, 128),
        manifold3d.Manifold.sphere(1.0, 96).scale([20, 15, 10]),
    ],
    ids=["ball", "egg"],
)
def test_a_part_without_a_plane_is_enveloped_in_full(solid):
    part = part_of(solid)
    assert not part.restrained.any()
    assert "none" in explanation(part) and "no planar face" in explanation(part)


def test_planes_that_show_are_not_proposed_where_nothing_rests():
    lens = manifold3d.Manifold.sphere(20.0, 96).trim_by_plane([1, 0, 0], 5.0)
    part = part_of(lens)
    assert not part.restrained.any()
    assert "none" in explanation(part) and "normal:-1,0,0" in explanation(part)


def test_a_rest_of_a_few_facets_is_no_base():
    """The lowest facets of a ball are flat on the plate, but no base."""
    part = part_of(manifold3d.Manifold.sphere(20.0, 64).trim_by_plane([0, 0, 1], -19.99))
    assert not part.restrained.any()


def test_feet_are_one_base():
    table = manifold3d.Manifold.cube([40.0, 40.0, 5.0]).translate([0, 0, 10])
    for x in (0, 32):
        for y in (0, 32):
            table += manifold3d.Manifold.cube([8.0, 8.0, 10.0]).translate([x, y, 0])
    part = part_of(table)
    assert part.face_areas[part.restrained].sum() == pytest.approx(256)
    ceiling = [p for p in rank_planes(part) if "hangs over" in p.reason]
    assert len(ceiling) == 1 and ceiling[0].score < ENOUGH


def test_ranking_does_not_depend_on_the_order_of_faces():
    part = part_of(
        manifold3d.Manifold.cube([40.0, 30.0, 12.0]) ^ manifold3d.Manifold.sphere(30, 48)
    )
    order = np.random.default_rng(5).permutation(len(part.faces))
    other = load_part((part.vertices, part.faces[order]), AUTO)
    told = [propose_restraint(p, AUTO).explanation for p in (part, other)]
    assert told[0] == told[1]
    assert (other.restrained == part.restrained[order]).all()
