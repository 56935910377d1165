# SPDX-License-Identifier: Apache-2.0
"""Layers are surfaces: no edge with three faces, no open edge but on the restraint region."""

import numpy as np
import pytest

from vega_planner.layers import generate_layers
from vega_planner.layers.distance_field import DistanceField
from vega_planner.layers.touching import fans_parted, parted
from vega_planner.part.topology import edge_census
from vega_planner.settings import LayerSettings

from .shapes import Solid, base, part_of
from .test_field_layers import rim_of

CUBE = np.asarray(Solid.cube((1, 1, 1)).to_mesh64().tri_verts, np.int64)


def drilled(size: float, turns: tuple[float, float, float]) -> Solid:
    block = Solid.cube((size, 0.6 * size, 0.3 * size))
    hole = Solid.cylinder(size, 0.15 * size, 0.15 * size, 40)
    return (block - hole.translate((0.4 * size, 0.3 * size, -1))).rotate(turns)


def knobby(size: float, phase: float) -> Solid:
    """A ball with bumps, about as high as its layers are thick."""

    def bump(p):
        return p * (1 + 0.08 * np.sin(4 * p[:, :1] + phase) * np.cos(5 * p[:, 1:2] + 3 * p[:, 2:]))

    return Solid.sphere(1, 48).warp_batch(bump).scale((size / 2,) * 3)


def cut_flat(solid: Solid) -> Solid:
    low, high = solid.bounding_box()[2], solid.bounding_box()[5]
    return solid.trim_by_plane((0, 0, 1), low + 0.2 * (high - low))


def plate(turns: tuple[float, float, float]) -> Solid:
    return Solid.cube((20, 16, 2.5)).rotate(turns)


#: Solids and thicknesses; the first ones once touched themselves, or had a rim off the region.
PARTS = {
    "drilled": (lambda: drilled(32.49538, (18.310972, 23.608201, 67.532820)), 1.0),
    "drilled_large": (lambda: drilled(87.71141, (15.992333, 54.796646, 63.437827)), 0.97),
    "knobby": (lambda: knobby(40, 0.3), 1.5),
    "knobby_fine": (lambda: knobby(20, 1.7), 0.6),
    "plate": (lambda: plate((20, 50, 70)), 0.4),
    "plate_aslant": (lambda: plate((81, 13, 45)), 0.8),
}


def check(part, t):
    region = None
    if part.restrained.any():
        region = DistanceField(part.vertices, part.faces[part.restrained])
    depths = DistanceField.of_part(part).distances
    layers = generate_layers(part, LayerSettings(thickness_mm=t)).layers
    assert layers
    for layer in layers:
        if len(layer.faces) == 0:
            continue
        assert np.abs(depths(layer.vertices) - layer.depth_mm).max() < 0.1
        centres = layer.vertices[layer.faces].mean(1)
        assert np.abs(depths(centres) - layer.depth_mm).max() < 0.25
        rim = rim_of(layer)  # no edge has more than two faces
        if region is None:
            assert len(rim) == 0
            assert edge_census(layer.faces).is_closed
        else:
            assert region.distances(layer.vertices[rim]).max(initial=0.0) < 0.01


@pytest.mark.parametrize("name", [name for name in PARTS if name != "drilled_large"])
def test_layers_of_a_part_all_of_whose_surface_is_buffered_are_closed(name):
    make, t = PARTS[name]
    check(part_of(make()), t)


@pytest.mark.parametrize("name", PARTS)
def test_layers_of_a_part_on_a_flat_base_end_on_it_alone(name):
    make, t = PARTS[name]
    check(part_of(cut_flat(make()), base), t)


def test_boxes_that_touch_along_an_edge_are_parted_there():
    points = np.asarray(Solid.cube((1, 1, 1)).to_mesh64().vert_properties)[:, :3]
    other = points + np.array([1, 1, 0])
    number = np.arange(8, 16)
    shared = []
    for k, place in enumerate(other):
        same = np.flatnonzero((points == place).all(1))
        if len(same):
            number[k] = same[0]
            shared.append(same[0])
    faces = np.concatenate([CUBE, number[CUBE]])
    assert len(shared) == 2
    assert edge_census(faces).crowded == 1
    twice = np.zeros(16, bool)
    twice[shared] = True
    result, copied = parted(faces, twice)
    assert edge_census(result).is_closed
    assert len(copied) == 1 and copied[0] in shared
    source = np.concatenate([np.arange(16), copied])
    np.testing.assert_array_equal(source[result], faces)


def test_a_surface_without_such_edges_stays_as_it_is():
    result, copied = parted(CUBE, np.ones(8, bool))
    np.testing.assert_array_equal(result, CUBE)
    assert len(copied) == 0


def fans(faces: np.ndarray, v: int) -> int:
    """Count the fans of faces round a vertex: faces that share an edge there hang together."""
    rings = [set(face.tolist()) - {v} for face in faces if v in face]
    count = 0
    while rings:
        count += 1
        fan = rings.pop()
        while beside := [ring for ring in rings if ring & fan]:
            fan |= set().union(*beside)
            rings = [ring for ring in rings if ring not in beside]
    return count


def wheel(middle: int, first: int, count: int) -> list[list[int]]:
    return [[middle, first + k, first + (k + 1) % count] for k in range(count)]


@pytest.mark.parametrize("open_fans", [0, 1, 2, 3])
@pytest.mark.parametrize("closed_fans", [0, 1, 2])
def test_fans_that_share_a_vertex_alone_are_parted(open_fans, closed_fans):
    rows: list[list[int]] = []
    for k in range(closed_fans):
        rows += wheel(0, 1 + 10 * k, 4 + k)
    for k in range(open_fans):
        rows += wheel(0, 51 + 10 * k, 5)[: 1 + k]
    if not rows:
        return
    faces = np.random.default_rng(2).permutation(np.array(rows))
    result, copied = fans_parted(faces, np.arange(100) == 0)
    assert len(copied) == open_fans + closed_fans - 1
    assert (copied == 0).all()
    np.testing.assert_array_equal(np.append(np.arange(100), copied)[result], faces)
    assert all(fans(result, v) == 1 for v in (0, *range(100, 100 + len(copied))))
    np.testing.assert_array_equal(fans_parted(faces, np.zeros(100, bool))[0], faces)


@pytest.mark.parametrize("restrain", [base, None], ids=["on its base", "all round"])
def test_what_stays_of_a_sheet_nowhere_hangs_together_at_one_vertex(restrain):
    """Along a ring of unequal thickness pieces of the last levels move into the core."""
    ring = Solid.revolve(Solid.sphere(4, 32).slice(0).translate((9, 0)), 64)
    stack = generate_layers(part_of(ring, restrain), LayerSettings(thickness_mm=0.75))
    assert stack.cores
    for sheet in stack.sheets:
        use = np.bincount(sheet.faces.ravel(), minlength=len(sheet.vertices))
        assert use.min(initial=1) > 0
        rim = np.unique(rim_of(sheet))
        order = np.argsort(sheet.faces.ravel(), kind="stable")
        around = np.split(order // 3, np.cumsum(use)[:-1])
        assert all(fans(sheet.faces[around[v]], v) == 1 for v in rim)
