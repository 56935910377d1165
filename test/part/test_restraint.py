# SPDX-License-Identifier: Apache-2.0
"""The restraint region: each SPEC selects what it says, and says what it cannot."""

from __future__ import annotations

import manifold3d
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vega_planner.errors import BadRestraint
from vega_planner.part import load_part
from vega_planner.part.regions import smooth_regions, squared_distances
from vega_planner.settings import PartSettings


def arrays(solid):
    mesh = solid.to_mesh64()
    return np.array(mesh.vert_properties)[:, :3], np.array(mesh.tri_verts).astype(np.int64)


def part_of(solid, *brr, **more):
    return load_part((*arrays(solid), "thing"), PartSettings(brr=brr, **more))


def block():
    return manifold3d.Manifold.cube([10.0, 20.0, 30.0])


def cylinder():
    return manifold3d.Manifold.cylinder(20.0, 8.0, 8.0, 72)


def restrained_area(part):
    return float(part.face_areas[part.restrained].sum())


@pytest.mark.parametrize(
    ("brr", "area"),
    [
        (("none",), 0.0),
        ((), 0.0),
        (("down",), 200.0),
        (("auto",), 200.0),
        (("normal:0,0,1",), 200.0),
        (("normal:0,0,2:1",), 200.0),
        (("normal:1,0,0",), 600.0),
        (("normal:1,0,0", "normal:-1,0,0"), 1200.0),
        (("normal:0,0,1", "down", "none"), 400.0),
        (("point:0,0,99",), 200.0),
        (("point:5,0,15",), 600.0),
        (("point:0,-11,15",), 300.0),
        (("not:normal:0,0,1:20",), 2000.0),
        (("not:down",), 2000.0),
        (("not:not:down",), 200.0),
        (("normal:1,1,0:46",), 900.0),
        (("normal:0,0,-1:90",), 2000.0),
        (("point:0,0,99", "normal:0,-1,0:10"), 500.0),
        ((" down ",), 200.0),
    ],
)
def test_a_block_gives_up_the_sides_that_are_named(brr, area):
    part = part_of(block(), *brr)
    assert restrained_area(part) == pytest.approx(area, abs=1e-9)
    assert part.brr == (brr or ("none",))


def test_a_point_takes_the_whole_smooth_region_and_no_more():
    part = part_of(cylinder(), "point:20,0,10")
    side = np.abs(part.face_normals[:, 2]) < 0.5
    assert (part.restrained == side).all()


def test_a_smaller_angle_splits_a_region():
    part = part_of(cylinder(), "point:20,0,10", smooth_angle_deg=2.0)
    assert restrained_area(part) == pytest.approx(2 * 8 * np.sin(np.pi / 72) * 20, rel=1e-6)


def test_down_on_a_ball_is_the_cap_that_looks_down_within_the_edge_angle():
    part = part_of(manifold3d.Manifold.sphere(10.0, 64), "down", edge_angle_deg=40.0)
    looks_down = -part.face_normals[:, 2] >= np.cos(np.radians(40.0))
    assert (part.restrained == looks_down).all()


def test_down_takes_every_foot_and_no_ceiling():
    table = manifold3d.Manifold.cube([40.0, 40.0, 5.0]).translate([0, 0, 10])
    for x in (0, 32):
        for y in (0, 32):
            table += manifold3d.Manifold.cube([8.0, 8.0, 10.0]).translate([x, y, 0])
    assert restrained_area(part_of(table, "down")) == pytest.approx(4 * 64, rel=1e-9)


def test_face_indices_are_those_of_the_part(tmp_path):
    first = part_of(cylinder(), "none")
    wanted = np.flatnonzero(first.face_normals[:, 2] > 0.9)
    path = tmp_path / "top.txt"
    path.write_text("# the top\n" + ", ".join(map(str, wanted[:5])) + "\n")
    with path.open("a") as file:
        file.write("\n".join(map(str, wanted[5:])))
    part = part_of(cylinder(), f"faces:{path}")
    assert (np.flatnonzero(part.restrained) == wanted).all()
    assert (part_of(cylinder(), f"not:faces:{path}").restrained == ~part.restrained).all()


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ("up", "choices: none, auto, down, normal"),
        ("down:3", "takes no argument"),
        ("normal:1,0", "3"),
        ("normal:a,b,c", "normal:a,b,c"),
        ("normal:0,0,0", "points nowhere"),
        ("normal:0,0,1:200", "0 to 180"),
        ("normal:1,1,1:5", "larger angle"),
        ("normal:0,0,nan", "finite"),
        ("point:1,2", "3"),
        ("faces:", "names no file"),
        ("faces:/nowhere/a.txt", "cannot be read"),
        ("not:none", "whole surface"),
        ("not:", "choices"),
        ("normal:0,0,1:180", "whole surface"),
    ],
)
def test_a_spec_that_cannot_be_meant_is_refused_with_what_could(spec, words):
    with pytest.raises(BadRestraint) as caught:
        part_of(block(), spec)
    assert words in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [("1 2 x", "whole numbers"), ("3 99", "face 99"), ("-1", "face -1"), ("", "no face")],
)
def test_a_face_file_that_does_not_fit_is_refused(tmp_path, text, words):
    path = tmp_path / "faces.txt"
    path.write_text(text)
    with pytest.raises(BadRestraint, match=words):
        part_of(block(), f"faces:{path}")


def test_a_part_on_a_sharp_edge_has_no_down_and_the_error_helps():
    roof = manifold3d.Manifold.cube([10.0] * 3).rotate([45.0, 0.0, 0.0])
    with pytest.raises(BadRestraint, match="stands on an edge or a point; try normal"):
        part_of(roof, "down")


def test_a_body_that_is_restrained_all_over_is_told():
    pair = manifold3d.Manifold.cube([10.0] * 3) + manifold3d.Manifold.cube(
        [10.0, 10.0, 5.0]
    ).translate([20, 0, 0])
    part = part_of(pair, "not:point:-10,0,10")
    assert any("restrained all over" in line for line in part.warnings)
    assert not any("restrained all over" in line for line in part_of(pair, "down").warnings)


@given(st.floats(0, 360), st.integers(0, 2**32 - 1))
@settings(deadline=None, derandomize=True, max_examples=15)
def test_a_region_turns_with_the_part(turn, seed):
    """Directions given in turned axes select the turned faces."""
    solid = manifold3d.Manifold.sphere(10.0, 24)
    axis = np.random.default_rng(seed).normal(size=3)
    angle = np.radians(turn)
    c, s = np.cos(angle), np.sin(angle)
    turned = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ axis
    plain = part_of(solid, "normal:{},{},{}:35.3".format(*axis))
    moved = part_of(solid.rotate([0, 0, turn]), "normal:{},{},{}:35.3".format(*turned))
    assert restrained_area(moved) == pytest.approx(restrained_area(plain), rel=1e-6)


@given(st.tuples(*[st.floats(-30, 30)] * 3))
@settings(deadline=None, derandomize=True, max_examples=40)
def test_distances_to_triangles_equal_a_dense_sampling(point):
    vertices, faces = arrays(manifold3d.Manifold.tetrahedron().scale([10, 6, 3]))
    share = np.linspace(0, 1, 120)
    u, v = (g.ravel() for g in np.meshgrid(share, share, indexing="ij"))
    keep = u + v <= 1
    weights = np.stack([1 - u - v, u, v], axis=1)[keep]
    found = np.sqrt(squared_distances(np.array(point), vertices, faces))
    for face, distance in zip(faces, found):
        samples = weights @ vertices[face]
        nearest = np.linalg.norm(samples - point, axis=1).min()
        assert distance <= nearest + 1e-9
        assert distance >= nearest - 0.2


def test_smooth_regions_of_a_cylinder_are_its_side_and_its_ends():
    part = part_of(cylinder(), "none")
    assert len(np.unique(smooth_regions(part, 20.0))) == 3
    assert len(np.unique(smooth_regions(part, 90.0))) == 1
    assert len(np.unique(smooth_regions(part, 1.0))) == 2 + 72
