# SPDX-License-Identifier: Apache-2.0
"""Folded triangles at the rim of a sheet are found, and no others."""

from __future__ import annotations

import numpy as np

from vega_planner.layers.folds import folded_ears


def fan(tip):
    """Two triangles on one edge; the second ends in a point of the plane."""
    vertices = np.array([[0.0, 0, 0], [2, 0, 0], [1, 2, 0], [*tip, 0]])
    return vertices, np.array([[0, 1, 2], [1, 0, 3]])


def test_ear_that_lies_on_its_neighbour_is_marked_and_one_beside_it_is_not():
    assert folded_ears(*fan((1, 0.1)))[1]
    assert not folded_ears(*fan((1, -0.1))).any()


def test_sheet_without_a_rim_has_no_ears():
    vertices = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]])
    assert not folded_ears(vertices, faces).any()
    assert len(folded_ears(vertices, faces[:0])) == 0
