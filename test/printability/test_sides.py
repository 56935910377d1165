# SPDX-License-Identifier: Apache-2.0
"""From which side a face is printed that neither side offers as it is."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Layer
from vega_planner.printability.sides import (
    INSIDE,
    NEITHER,
    OUTSIDE,
    Side,
    with_hope_inside,
)


def strip(count):
    """A strip of triangles of 1 mm, vertex k at x = k / 2."""
    x = 0.5 * np.arange(count + 2)
    vertices = np.column_stack([x, np.arange(count + 2) % 2, 0 * x])
    faces = np.arange(count)[:, None] + np.arange(3)
    return Layer(0, "envelope", 0.4, vertices, faces, np.full(len(x), 0.8))


def side(code, hopeful):
    axes = np.tile([0.0, 0.0, 1.0], (len(code), 1))
    yes = np.ones(len(code), np.bool_)
    return Side(axes, np.array(code), yes, yes, yes, np.array(hopeful, np.bool_))


def test_only_what_neither_side_offers_is_hoped_for_from_inside():
    layer = strip(4)
    #             printable  hopeful           neither
    inside = side([0, 0, 3, 3, 4, 4], [0, 0, 1, 1, 0, 0])
    label = np.array([OUTSIDE, NEITHER, NEITHER, NEITHER])
    found, now = with_hope_inside(layer, inside, label)
    # faces 1 (one printable, two hopeful) and 2 (two hopeful) gain, face 3 (one) does not
    assert now.tolist() == [OUTSIDE, INSIDE, INSIDE, NEITHER]
    assert found.code.tolist() == [0, 0, 0, 0, 4, 4]
    assert inside.code.tolist() == [0, 0, 3, 3, 4, 4]


def test_without_hope_nothing_changes():
    layer = strip(2)
    inside, label = side([3, 3, 3, 3], [0, 0, 0, 0]), np.array([NEITHER, NEITHER])
    assert with_hope_inside(layer, inside, label) == (inside, label)
