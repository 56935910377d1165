# SPDX-License-Identifier: Apache-2.0
"""Slits in sheets: edges that lie on each other and belong to different vertices."""

import numpy as np
import pytest

from vega_planner.layers.tidy import _zipped

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
