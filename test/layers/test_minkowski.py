# SPDX-License-Identifier: Apache-2.0
"""The literal engine against closed forms: boxes, cylinders, balls, slots."""

from __future__ import annotations

import manifold3d
import numpy as np
import pytest

from vega_planner.errors import Cancelled
from vega_planner.layers.minkowski import (
    facet_error_mm,
    minkowski_layers,
    swept_triangle,
    unit_ball,
)
from vega_planner.part import load_part
from vega_planner.part.regions import squared_distances
from vega_planner.part.topology import directed_edges
from vega_planner.settings import LayerSettings, PartSettings

T = 0.8
LAYERS = LayerSettings(thickness_mm=T, engine="minkowski")


def part_of(solid, *brr):
    mesh = solid.to_mesh64()
    return load_part(
        (np.array(mesh.vert_properties)[:, :3], np.array(mesh.tri_verts).astype(np.int64)),
        PartSettings(brr=brr),
    )


def box(*sides):
    return manifold3d.Manifold.cube(list(sides))


def stack_of(solid, *brr, segments=16):
    return minkowski_layers(part_of(solid, *brr), LAYERS, segments=segments)


def rim(layer):
    """Vertices on edges of one face."""
    edges = np.sort(directed_edges(layer.faces), axis=1)
    found, uses = np.unique(edges, axis=0, return_counts=True)
    return layer.vertices[np.unique(found[uses == 1])]


def test_a_prism_that_is_free_on_top_gives_the_planes_of_a_slicer():
    stack = stack_of(box(40, 30, 12), "not:normal:0,0,1:20")
    assert len(stack.layers) == 15
    for index, layer in enumerate(stack.layers):
        depth = (index + 0.5) * T
        assert layer.depth_mm == pytest.approx(depth)
        np.testing.assert_allclose(layer.vertices[:, 2], 12 - depth, atol=1e-9)
        assert layer.area == pytest.approx(1200, rel=1e-9)
        np.testing.assert_allclose(layer.face_normals, [[0, 0, 1]] * len(layer.faces), atol=1e-9)
    assert stack.warnings == () and stack.engine == "minkowski" and stack.cores == ()


def test_a_box_on_its_base_gives_boxes_open_below():
    stack = stack_of(box(20, 16, 6), "down")
    assert len(stack.layers) == 7
    for layer in stack.layers:
        d = layer.depth_mm
        x, y, z = 20 - 2 * d, 16 - 2 * d, 6 - d
        assert layer.area == pytest.approx(x * y + 2 * (x + y) * z, rel=1e-6)
        edge = rim(layer)
        assert np.abs(edge[:, 2]).max() < 1e-9
        np.testing.assert_allclose(np.ptp(edge[:, :2], axis=0), [x, y], atol=1e-6)


def test_full_enveloping_of_a_box_gives_closed_boxes():
    stack = stack_of(box(12, 10, 6), "none")
    assert len(stack.layers) == 4
    for layer in stack.layers:
        sides = np.array([12, 10, 6]) - 2 * layer.depth_mm
        np.testing.assert_allclose(np.ptp(layer.vertices, axis=0), sides, atol=1e-6)
        assert layer.area == pytest.approx(2 * (sides.prod() / sides).sum(), rel=1e-6)
        assert len(rim(layer)) == 0


def test_two_restraint_regions_hold_at_once():
    stack = stack_of(box(20, 12, 8), "normal:1,0,0", "normal:-1,0,0")
    assert len(stack.layers) == 5
    for layer in stack.layers:
        d = layer.depth_mm
        assert layer.area == pytest.approx(2 * 20 * (12 - 2 * d + 8 - 2 * d), rel=1e-6)
        assert np.abs(np.abs(rim(layer)[:, 0]) - 10).max() < 1e-9


def test_a_cylinder_shrinks_by_the_offset_within_the_ball_s_facets():
    stack = stack_of(manifold3d.Manifold.cylinder(4.0, 4.0, 4.0, 24), "normal:0,0,1", "down")
    apothem = 4 * np.cos(np.pi / 24)
    assert len(stack.layers) == 5
    for layer in stack.layers:
        reach = np.hypot(*layer.vertices[:, :2].T).min() * 1.0
        inner = (apothem - layer.depth_mm) / np.cos(np.pi / 24)
        assert reach == pytest.approx(inner, abs=1e-3)


@pytest.mark.parametrize("brr", ["none", "down"])
def test_every_layer_lies_at_its_depth_from_the_free_surface(brr):
    """The distance is measured afresh from the part; facets may leave it too small."""
    solid = manifold3d.Manifold.sphere(2.2, 8).trim_by_plane([0, 0, 1], -0.5)
    part = part_of(solid, brr)
    stack = minkowski_layers(part, LAYERS, segments=16)
    assert len(stack.layers) >= 2
    free = part.faces[~part.restrained]
    for layer in stack.layers:
        distance = np.sqrt(
            [squared_distances(p, part.vertices, free).min() for p in layer.vertices]
        )
        slack = facet_error_mm(T, 16) * (layer.index + 1) + 2e-3 * (layer.index + 1)
        assert distance.max() < layer.depth_mm + slack
        assert distance.min() > layer.depth_mm - slack


def test_an_open_layer_ends_on_a_curved_restraint_region():
    solid = manifold3d.Manifold.cylinder(4, 3, 3, 12) - manifold3d.Manifold.sphere(
        5.0, 24
    ).translate([0, 0, -4])
    part = part_of(solid, "normal:0,0,-1:60")
    stack = minkowski_layers(part, LAYERS, segments=16)
    base = part.faces[part.restrained]
    for layer in stack.layers:
        ends = rim(layer)
        assert len(ends)
        gaps = [squared_distances(p, part.vertices, base).min() for p in ends]
        assert np.sqrt(max(gaps)) < 0.01


def test_the_layers_hold_the_volume_of_the_part():
    """Sum of area times thickness, for a box whose layers are known to fill it."""
    stack = stack_of(box(20, 16, 8), "not:normal:0,0,1:20")
    assert sum(layer.area for layer in stack.layers) * T == pytest.approx(20 * 16 * 8, rel=1e-9)


def test_the_paper_s_ball_jumps_a_slot_narrower_than_a_layer():
    """Literal semantics: C does not see the restraint region.

    A block is enveloped from one side; a slot from above is in the way. The layers at
    2.0 and 2.8 mm lie on either side of the narrow slot and lead straight on; they have
    to go round the wide one.
    """
    narrow = box(2, 5, 4) - box(6, 0.4, 6).translate([-1, 2.2, 1.0])
    wide = box(2, 5, 4) - box(6, 1.2, 6).translate([-1, 1.8, 1.0])
    assert len(stack_of(narrow, "not:point:0,-2.5,2", segments=8).layers) == 6
    assert len(stack_of(wide, "not:point:0,-2.5,2", segments=8).layers) > 6


def test_a_part_thinner_than_a_layer_has_no_layer():
    assert stack_of(box(10, 10, 0.7), "none").layers == ()


def test_a_body_without_a_free_face_does_not_hold_up_the_rest():
    pair = box(8, 8, 4) + box(8, 8, 3).translate([12, 0, 0])
    stack = stack_of(pair, "not:point:-6,0,9")
    assert len(stack.layers) == 5
    assert all(layer.vertices[:, 0].max() < 0 for layer in stack.layers)


def test_a_swept_triangle_is_exact_on_its_flat_sides():
    corners = np.array([[0, 0, 0], [5, 0, 0], [0, 5, 0.0]])
    swept = swept_triangle(corners, np.array([0, 0, 1.0]), 0.7 * unit_ball(16))
    bounds = swept.bounding_box()
    assert bounds[2] == pytest.approx(-0.7) and bounds[5] == pytest.approx(0.7)
    steiner = 2 * 0.7 * 12.5 + np.pi / 2 * 0.7**2 * (10 + 50**0.5) + 4 / 3 * np.pi * 0.7**3
    assert 0.96 * steiner < swept.volume() < steiner


def test_the_same_part_gives_the_same_bytes():
    solid = manifold3d.Manifold.sphere(2.4, 8).trim_by_plane([0, 0, 1], 0.0)
    first, second = stack_of(solid, "down", segments=12), stack_of(solid, "down", segments=12)
    assert len(first.layers) == len(second.layers) > 1
    for a, b in zip(first.layers, second.layers):
        assert a.vertices.tobytes() == b.vertices.tobytes()
        assert a.faces.tobytes() == b.faces.tobytes()


def test_it_reports_progress_that_never_falls_and_can_be_cancelled():
    seen = []
    part = part_of(box(10, 10, 6), "down")
    minkowski_layers(part, LAYERS, report=lambda p: seen.append((p.fraction, p.layers)))
    assert seen == sorted(seen) and seen[-1][0] == 1.0

    def stop(progress):
        if progress.layers == 2:
            raise Cancelled("stop")

    with pytest.raises(Cancelled):
        minkowski_layers(part, LAYERS, report=stop)


def test_another_thickness_gives_other_layers():
    part = part_of(box(10, 10, 6), "down")
    stack = minkowski_layers(part, LayerSettings(thickness_mm=1.5, engine="minkowski"))
    assert [layer.depth_mm for layer in stack.layers] == [0.75, 2.25, 3.75]
    assert all((layer.thickness == 1.5).all() for layer in stack.layers)
