# SPDX-License-Identifier: Apache-2.0
"""The paper's transfer of the restraint region against exact provenance."""

from __future__ import annotations

import manifold3d
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vega_planner.layers.minkowski import minkowski_layers
from vega_planner.layers.transfer import (
    restraint_disagreement,
    spherical_median,
    transfer_restraint,
)
from vega_planner.part import load_part
from vega_planner.settings import LayerSettings, PartSettings

unit_vectors = st.integers(0, 2**32 - 1).map(
    lambda seed: (lambda v: v / np.linalg.norm(v))(np.random.default_rng(seed).normal(size=3))
)


def cost(direction, normals, weights=None):
    angles = np.arccos(np.clip(normals @ direction, -1, 1))
    return float(angles @ (np.ones(len(normals)) if weights is None else weights))


def scattered(axis, spread, count, seed):
    """Unit vectors round an axis."""
    vectors = axis + spread * np.random.default_rng(seed).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def arrays(solid):
    mesh = solid.to_mesh64()
    return np.array(mesh.vert_properties)[:, :3], np.array(mesh.tri_verts).astype(np.int64)


def normals_of(vertices, faces):
    c = vertices[faces]
    n = np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0])
    return n / np.linalg.norm(n, axis=1, keepdims=True)


@given(unit_vectors)
@settings(deadline=None, derandomize=True)
def test_the_median_of_one_direction_is_that_direction(normal):
    np.testing.assert_allclose(spherical_median(np.array([normal] * 4)), normal, atol=1e-9)


@given(unit_vectors, st.integers(0, 2**32 - 1))
@settings(deadline=None, derandomize=True, max_examples=40)
def test_no_direction_nearby_has_a_smaller_sum_of_angles(axis, seed):
    normals = scattered(axis, 0.4, 31, seed)
    median = spherical_median(normals)
    least = cost(median, normals)
    assert np.linalg.norm(median) == pytest.approx(1)
    for other in (*scattered(median, 0.02, 60, seed + 1), *scattered(median, 1e-4, 20, seed)):
        assert cost(other, normals) >= least - 1e-7
    assert all(cost(normal, normals) >= least - 1e-9 for normal in normals)


def test_a_few_outliers_do_not_move_the_median():
    """Less than half the weight cannot pull an L1 median off a cluster at one point."""
    up = np.array([[0.0, 0.0, 1.0]] * 6)
    outliers = scattered(np.array([1.0, 0.2, 0.0]), 0.3, 5, 3)
    median = spherical_median(np.vstack([up, outliers]))
    np.testing.assert_allclose(median, [0, 0, 1], atol=1e-6)
    mean = np.vstack([up, outliers]).mean(0)
    assert np.degrees(np.arccos(mean[2] / np.linalg.norm(mean))) > 20


def test_weights_count_as_repetitions():
    normals = scattered(np.array([0.0, 1.0, 0.0]), 0.5, 7, 11)
    weights = np.array([1, 2, 3, 1, 2, 1, 4])
    np.testing.assert_allclose(
        spherical_median(normals, weights),
        spherical_median(np.repeat(normals, weights, axis=0)),
        atol=1e-6,
    )


@given(st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1))
@settings(deadline=None, derandomize=True, max_examples=30)
def test_the_median_turns_with_the_directions_and_forgets_their_order(seed, turn):
    rng = np.random.default_rng(turn)
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    rotation *= np.sign(np.linalg.det(rotation))
    normals = scattered(np.array([0.3, -0.5, 0.8]), 0.3, 21, seed)
    median = spherical_median(normals)
    other = spherical_median(normals[rng.permutation(21)] @ rotation.T)
    np.testing.assert_allclose(other, rotation @ median, atol=1e-5)


def eroded_box():
    """A box and itself eroded by 1 mm, kept on its base."""
    before, faces = arrays(manifold3d.Manifold.cube([20.0, 16.0, 8.0]).translate([-10, -8, 0]))
    after, more = arrays(manifold3d.Manifold.cube([18.0, 14.0, 7.0]).translate([-9, -7, 0]))
    return before, faces, after, more


@pytest.mark.parametrize("direction", [(0, 0, -1), (0, 0, 1), (1, 0, 0), (0, -1, 0)])
def test_a_side_of_a_box_is_handed_on_to_the_same_side(direction):
    before, faces, after, more = eroded_box()
    restrained = normals_of(before, faces) @ direction > 0.9
    chosen = transfer_restraint(before, faces, restrained, after, more, 30.0)
    assert (chosen == (normals_of(after, more) @ direction > 0.9)).all()


def test_several_surfaces_are_each_handed_on():
    before, faces, after, more = eroded_box()
    restrained = normals_of(before, faces)[:, 2] < 0.9
    chosen = transfer_restraint(before, faces, restrained, after, more, 30.0)
    assert (chosen == (normals_of(after, more)[:, 2] < 0.9)).all()


def test_every_body_that_the_solid_falls_into_gets_its_share():
    before, faces = arrays(manifold3d.Manifold.cube([30.0, 8.0, 6.0]))
    halves = manifold3d.Manifold.cube([10.0, 6.0, 5.0]).translate([1, 1, 0])
    after, more = arrays(halves + halves.translate([17, 0, 0]))
    restrained = normals_of(before, faces)[:, 2] < -0.9
    chosen = transfer_restraint(before, faces, restrained, after, more, 30.0)
    assert (chosen == (normals_of(after, more)[:, 2] < -0.9)).all()


def test_no_restraint_hands_on_none():
    before, faces, after, more = eroded_box()
    none = np.zeros(len(faces), dtype=bool)
    assert not transfer_restraint(before, faces, none, after, more, 30.0).any()


def test_a_curved_region_is_handed_on_whole():
    """The cap of a cylinder's bore: a region wider than θ_edge round its median."""
    solid = manifold3d.Manifold.cylinder(20.0, 10.0, 10.0, 48).rotate([0, 90, 0])
    smaller = manifold3d.Manifold.cylinder(18.0, 10.0, 10.0, 48).translate([0, 0, 1])
    before, faces = arrays(solid)
    after, more = arrays(smaller.rotate([0, 90, 0]))
    side = np.abs(normals_of(before, faces)[:, 0]) < 0.5
    chosen = transfer_restraint(before, faces, side, after, more, 30.0)
    assert (chosen == (np.abs(normals_of(after, more)[:, 0]) < 0.5)).all()


@given(st.integers(0, 2**32 - 1))
@settings(deadline=None, derandomize=True, max_examples=20)
def test_the_choice_does_not_depend_on_the_order_of_faces_or_labels(seed):
    before, faces = arrays(manifold3d.Manifold.sphere(10.0, 24).trim_by_plane([0, 0, 1], 0.0))
    after, more = arrays(manifold3d.Manifold.sphere(9.0, 24).trim_by_plane([0, 0, 1], 0.0))
    restrained = normals_of(before, faces)[:, 2] < -0.99
    rng = np.random.default_rng(seed)
    plain = transfer_restraint(before, faces, restrained, after, more, 30.0)
    order, again = rng.permutation(len(faces)), rng.permutation(len(more))
    labels = rng.permutation(len(after))
    moved = np.empty_like(after)
    moved[labels] = after
    other = transfer_restraint(
        before, faces[order], restrained[order], moved, labels[more][again], 30.0
    )
    assert (other == plain[again]).all()
    assert (plain == (normals_of(after, more)[:, 2] < -0.99)).all()


def test_disagreement_is_the_area_in_one_over_the_area_in_any():
    vertices, faces = arrays(manifold3d.Manifold.cube([10.0, 10.0, 10.0]))
    normals = normals_of(vertices, faces)
    down, up = normals[:, 2] < -0.5, normals[:, 2] > 0.5
    assert restraint_disagreement(vertices, faces, down, down) == 0
    assert restraint_disagreement(vertices, faces, down, up) == pytest.approx(1)
    assert restraint_disagreement(vertices, faces, down, down | up) == pytest.approx(0.5)
    nothing = np.zeros(len(faces), dtype=bool)
    assert restraint_disagreement(vertices, faces, nothing, nothing) == 0


def warnings_of(solid, brr):
    vertices, faces = arrays(solid)
    part = load_part((vertices, faces), PartSettings(brr=(brr,)))
    stack = minkowski_layers(part, LayerSettings(), 30.0, segments=8)
    assert stack.layers
    return [line for line in stack.warnings if "disagrees" in line]


def test_the_transfer_agrees_with_provenance_on_plain_parts():
    """Also on a roof of 19 degrees: the ball leaves a step where free and restrained meet."""
    block = manifold3d.Manifold.cube([12.0, 10.0, 4.0])
    assert warnings_of(block, "down") == []
    assert warnings_of(block, "not:normal:0,0,1:20") == []
    roof = [[x, y, z] for y in (0, 9) for x, z in ((0, 0), (12, 0), (0, 4), (12, 4), (6, 5))]
    gable = manifold3d.Manifold.hull_points(np.array(roof, dtype=float))
    assert warnings_of(gable, "normal:-0.1644,0,0.9864:3") == []


def test_where_the_region_falls_apart_on_one_body_the_stack_says_so():
    """Two pads joined by a strip that vanishes: the paper goes on with one of them."""
    part = manifold3d.Manifold.cube([18.0, 6.0, 4.0]).translate([0, 0, 1])
    part += manifold3d.Manifold.cube([6.0, 6.0, 2.0])
    part += manifold3d.Manifold.cube([6.0, 6.0, 2.0]).translate([12, 0, 0])
    part += manifold3d.Manifold.cube([8.0, 0.6, 2.0]).translate([5, 2.7, 0])
    told = warnings_of(part, "down")
    assert told and "the exact one is used" in told[0]
