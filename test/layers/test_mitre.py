# SPDX-License-Identifier: Apache-2.0
"""Sharp edges of sheets are mitred: their corners are filled, the beads stay as they are."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from vega_planner.datatypes import Layer
from vega_planner.layers import generate_layers
from vega_planner.layers import mitre_kernels as kernels
from vega_planner.layers.distance_field import DistanceField
from vega_planner.layers.mitre import MOST, SHARP, _creases, find_strips
from vega_planner.layers.subdivide import split_long_edges
from vega_planner.settings import LayerSettings

from .shapes import box

T = 0.8


def sheet(mesh: trimesh.Trimesh, length: float = 0.5, thickness: float = T) -> Layer:
    vertices, faces = split_long_edges(np.array(mesh.vertices), np.array(mesh.faces), length)
    return Layer(0, "envelope", T / 2, vertices, faces, np.full(len(vertices), thickness))


def mitred(layer: Layer, t: float, field: DistanceField | None = None) -> Layer:
    return find_strips(layer, t, field.distances if field else None).on(layer, t)


def as_mesh(layer: Layer) -> trimesh.Trimesh:
    return trimesh.Trimesh(layer.vertices, layer.faces, process=False)


def is_covered(layer: Layer, points: np.ndarray) -> np.ndarray:
    found = DistanceField(layer.vertices, layer.faces).nearest(points)
    return found.distances <= layer.thickness[layer.faces].mean(1)[found.faces] / 2


def prism(angle: float, length: float = 6.0) -> trimesh.Trimesh:
    """A long edge over which the normals turn by an angle, at x = z = 0, along y."""
    lean = (np.pi - angle) / 2  # of both sides against the plane between them
    way = np.array([-np.cos(lean), np.sin(lean)]) * 5
    outline = np.array([[0.0, 0.0], way, [way[0], -way[1]]])
    return trimesh.creation.extrude_polygon(trimesh.path.polygons.Polygon(outline), length)


def corner_points(angle: float, count: int = 400) -> np.ndarray:
    """Points of the mitred corner outside the sharp edge of `prism`, away from its ends."""
    rng = np.random.default_rng(1)
    first = np.array([np.cos(angle / 2), np.sin(angle / 2)])
    second = np.array([np.cos(angle / 2), -np.sin(angle / 2)])
    plane = rng.uniform(-2 * T, 2 * T, (40 * count, 2))
    along = (plane @ first < T / 2) & (plane @ second < T / 2)
    # beside the edge the bands cover; the corner is what is beyond both their ends
    ways = np.array([[-first[1], first[0]], [second[1], -second[0]]])
    corner = (plane @ ways.T < 0).all(1)
    plane = plane[along & corner][:count]
    return np.column_stack([plane, rng.uniform(2, 4, len(plane))])


@pytest.mark.parametrize("degrees", [60, 75, 90])
def test_the_corner_outside_a_sharp_edge_is_covered(degrees):
    plain = sheet(prism(np.radians(degrees)))
    points = corner_points(np.radians(degrees))
    assert len(points) > 50
    assert 1 - is_covered(plain, points).mean() > 0.01
    assert is_covered(mitred(plain, T), points).mean() > (0.999 if degrees < 90 else 0.96)


def test_an_edge_of_a_box_costs_next_to_no_material():
    plain = sheet(trimesh.creation.box((8, 6, 5)))
    joined = mitred(plain, T)
    volume = [float(s.face_areas @ s.thickness[s.faces].mean(1)) for s in (plain, joined)]
    edges = 4 * (8 + 6 + 5)
    open_corners = edges * (1 - np.pi / 4) * (T / 2) ** 2
    assert volume[1] - volume[0] < open_corners / 2
    assert volume[1] > volume[0]


def test_a_mitred_sheet_is_the_same_closed_surface():
    plain = sheet(trimesh.creation.box((8, 6, 5)), 0.9)
    joined = mitred(plain, T)
    mesh = as_mesh(joined)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(240)
    assert mesh.area == pytest.approx(236)
    assert mesh.area_faces.min() > 1e-4


def test_beads_are_laid_as_thick_as_before():
    plain = sheet(trimesh.creation.box((8, 6, 5)), thickness=0.7)
    joined = mitred(plain, T)
    assert joined.mitre is not None
    assert np.abs(joined.bead_thickness - 0.7).max() < 1e-12
    assert joined.thickness.min() == pytest.approx(0.7)
    assert joined.thickness.max() <= MOST["envelope"] * T
    on_edge = (np.isclose(np.abs(joined.vertices), [4, 3, 2.5]).sum(1)) >= 2
    assert (joined.mitre[on_edge] > 1.4).all()
    assert (joined.mitre[~on_edge] == 1).all()


@pytest.mark.parametrize("inside", [False, True])
def test_smooth_and_hollow_edges_stay_as_they_are(inside):
    if inside:  # the edges of a hollow box are concave as seen from the outside of the sheet
        box = trimesh.creation.box((8, 6, 5))
        box.invert()
        plain = sheet(box)
    else:
        plain = sheet(trimesh.creation.icosphere(4, 6.0))
    assert mitred(plain, T) is plain


def test_new_points_are_on_the_level_set():
    part = trimesh.creation.box((12, 12, 12))
    field = DistanceField(np.array(part.vertices), np.array(part.faces))
    flat = trimesh.creation.box((11.2, 11.2, 11.2))
    dented = sheet(flat, 1.0)
    # a point pushed in takes the middles of its edges off the level set
    vertices = dented.vertices.copy()
    edge = np.flatnonzero(np.isclose(np.abs(vertices), 5.6).sum(1) == 2)[:5]
    vertices[edge] *= 0.98
    dented = Layer(0, "envelope", 0.4, vertices, dented.faces, dented.thickness)
    joined = mitred(dented, T, field)
    new = np.abs(field.distances(joined.vertices[len(vertices) :]) - 0.4)
    assert len(new) > 100
    assert new.max() < 0.04
    free = mitred(dented, T).vertices[len(vertices) :]
    assert len(free) > len(new)


def test_a_small_part_of_sharp_edges_is_filled():
    part = box(9, 8, 7)
    stack = generate_layers(part, LayerSettings(thickness_mm=T))
    points = np.random.default_rng(3).uniform(*part.bounds, (40000, 3))
    covered = np.zeros(len(points), bool)
    material = 0.0
    for layer in stack.sheets:
        covered |= is_covered(layer, points)
        material += float(layer.face_areas @ layer.thickness[layer.faces].mean(1))
    assert 1 - covered.mean() < 0.004
    assert material / part.volume - covered.mean() < 0.004
    plain = generate_layers(part, LayerSettings(thickness_mm=T, fill_core=False))
    assert all(layer.mitre is None for layer in plain.sheets)


@pytest.mark.parametrize("seed", range(4))
def test_both_ends_of_every_sharp_edge_are_among_the_vertices_where_faces_turn(seed):
    mesh = trimesh.creation.icosphere(3, 5.0)
    rng = np.random.default_rng(seed)
    rough = np.array(mesh.vertices) * (1 + 0.08 * rng.normal(size=(len(mesh.vertices), 1)))
    faces = np.array(mesh.faces, np.int64)
    bent = np.zeros(len(rough), np.uint8)
    kernels.mark_bent(rough, faces, np.cos(SHARP / 2), np.zeros(rough.shape), bent)
    bend, along, crease = _creases(rough, faces, np.ones(len(rough), np.uint8), 2, T)
    assert 0.1 < (bend > 0).mean() < 0.9
    assert bent[bend > 0].all()
    some = _creases(rough, faces, bent, 2, T)
    assert np.array_equal(some[0], bend)
    assert np.array_equal(some[1], along)
    beside = _creases(rough, faces, bend > 0, 1, T)[2]
    touching = (bend[faces] > 0) | (bend[np.roll(faces, -1, axis=1)] > 0)
    assert np.array_equal(beside[touching], crease[touching])
