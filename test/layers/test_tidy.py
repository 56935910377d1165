# SPDX-License-Identifier: Apache-2.0
"""Slits in sheets: edges that lie on each other and belong to different vertices."""

import numpy as np
import pytest

from vega_planner.layers import generate_layers
from vega_planner.layers.contour import Sheet
from vega_planner.layers.distance_field import DistanceField
from vega_planner.layers.geodesic import Sources
from vega_planner.layers.tidy import _zipped, tidy_sheet
from vega_planner.settings import LayerSettings

from .shapes import Solid, base, part_of

#: Two halves of a square that meet along y = 0, where the middle is there twice (1 and 3).
POINTS = np.array(
    [[0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 0, 0], [1, 1, 0], [1, -1, 0]], dtype=np.float64
)
ABOVE = [[0, 1, 4], [1, 2, 4]]
BELOW = [[0, 5, 3], [3, 5, 2]]


def open_edges(faces):
    ends = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    edges, uses = np.unique(ends, axis=0, return_counts=True)
    return edges[uses == 1], uses.max()


def test_a_slit_is_closed_and_the_outline_stays():
    faces = np.array(ABOVE + BELOW)
    assert len(open_edges(faces)[0]) == 8
    closed = _zipped(POINTS, faces)
    outline, most = open_edges(closed)
    assert {tuple(edge) for edge in outline} == {(0, 4), (2, 4), (0, 5), (2, 5)}
    assert most == 2
    assert len(closed) == len(faces)
    assert (POINTS[closed] == POINTS[faces]).all()


def test_a_long_slit_is_closed_from_end_to_end():
    n = 9
    line = np.column_stack([np.arange(n + 2.0), np.zeros((n + 2, 2))])
    twice = line[1:-1]
    points = np.concatenate([line, twice, [[5, 1, 0], [5, -1, 0]]])
    upper = np.arange(n + 2)
    lower = np.concatenate([[0], np.arange(n + 2, 2 * n + 2), [n + 1]])
    above = [[upper[k], upper[k + 1], 2 * n + 2] for k in range(n + 1)]
    below = [[lower[k], 2 * n + 3, lower[k + 1]] for k in range(n + 1)]
    closed = _zipped(points, np.array(above + below))
    outline, most = open_edges(closed)
    assert len(outline) == 4
    assert most == 2


@pytest.mark.parametrize("shift", [1e-9, 0.3])
def test_what_gapes_stays_open(shift):
    points = POINTS.copy()
    points[3, 1] -= shift
    faces = np.array(ABOVE + BELOW)
    np.testing.assert_array_equal(_zipped(points, faces), faces)


def test_two_sides_of_one_fold_are_not_joined():
    """Both halves hang on the same vertex: one for both would give an edge four faces."""
    points = np.concatenate([POINTS[:5], [[0.5, -1, 0], [1.5, -1, 0]]])
    faces = np.array([*ABOVE, [0, 5, 3], [3, 5, 4], [3, 4, 6], [3, 6, 2]])
    np.testing.assert_array_equal(_zipped(points, faces), faces)


def test_a_fin_in_a_slit_goes_and_the_slit_closes():
    """The middle is there twice; from it a double face leads to a point of its own."""
    middle, again, tip, north, west, south, east = range(7)
    points = np.array(
        [[0, 0, 0], [0, 0, 0], [0, 0.5, 0.1], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [1, 0, 0]],
        dtype=np.float64,
    )
    square = [[west, north, middle], [west, middle, south], [east, again, north]]
    fin = [[again, tip, north], [north, tip, middle]]
    faces = np.array([*square, [again, east, south], *fin])
    assert len(open_edges(faces)[0]) == 8
    left = _zipped(points, faces)
    outline, most = open_edges(left)
    assert {tuple(edge) for edge in outline} == {(3, 4), (3, 6), (4, 5), (5, 6)}
    assert most == 2
    assert len(left) == 4


def heights(points, faces):
    corners = points[faces]
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(1)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.linalg.norm(cross, axis=1) / sides


def area(points, faces):
    corners = points[faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.linalg.norm(cross, axis=1).sum() / 2


@pytest.mark.parametrize("places", [(1, 2), (2, 1), (1, 1.5), (0.5, 2.5), (1.5, 1.5)])
def test_faces_on_one_line_are_turned_out_of_a_flat_sheet(places):
    """Two faces without area lie between two halves of a square, back to back."""
    c, d = places
    points = np.array(
        [[0, 0, 1], [3, 0, 1], [c, 0, 1], [d, 0, 1], [1.5, 2, 1], [1.5, -2, 1]], dtype=np.float64
    )
    faces = np.array([[0, 2, 4], [2, 1, 4], [1, 3, 5], [3, 0, 5], [2, 0, 1], [0, 3, 1]])
    ground = DistanceField(
        np.array([[-9, -9, 0], [9, -9, 0], [0, 18, 0]], np.float64), np.array([[0, 1, 2]])
    )
    sheet = Sheet(
        1.0, points, faces, np.zeros(6, np.int64), np.zeros(6, bool), np.tile([0.0, 0, 1], (6, 1))
    )
    tidied = tidy_sheet(sheet, Sources.straight(ground), 0.8)
    assert heights(tidied.vertices, tidied.faces).min() > 0.1
    assert area(tidied.vertices, tidied.faces) == pytest.approx(6.0)
    outline, most = open_edges(tidied.faces)
    assert most == 2
    assert len(outline) == 4


def test_few_faces_of_a_part_with_straight_edges_have_no_area():
    """Middles of edges are put onto creases, where three of them lie on a line."""
    inside = Solid.cube((14, 8, 12)).translate((3, 3, 3))
    part = part_of(Solid.cube((20, 14, 10)) - inside, base)
    sheets = generate_layers(part, LayerSettings(thickness_mm=0.8)).sheets
    flat = np.concatenate([heights(sheet.vertices, sheet.faces) < 1e-4 for sheet in sheets])
    assert flat.mean() < 0.002
