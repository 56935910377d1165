# SPDX-License-Identifier: Apache-2.0
"""Segments sorted into a grid of cells, as the kernels of coverage look them up."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from vega_planner.datatypes import Floats, Ints
from vega_planner.toolpaths.coverage_kernels import bucket_segments

#: Where the segments of each cell begin, their numbers, the grid's low corner [mm], the edge
#: of a cell [mm] and the numbers of cells: what `distance_to_segments` and `gaps_beside` take.
Cells: TypeAlias = tuple[Ints, Ints, Floats, float, Ints]


def cells_within(a: Floats, b: Floats, low: Floats, high: Floats, size: float) -> Cells:
    """Sort segments into the cells of a box.

    Args:
        a, b: Starts and ends [mm], shape (n, 3).
        low, high: Corners of the box [mm], shape (3,).
        size: Edge of a cell [mm]; nothing farther than it from a point is found there.
    """
    shape = np.ceil((high - low) / size).astype(np.int64) + 1
    return (*bucket_segments(a, b, low, size, shape), low, size, shape)


def cells_around(a: Floats, b: Floats, size: float) -> Cells:
    """Sort segments into cells that reach a cell's edge beyond them all.

    Args:
        a, b: Starts and ends [mm], shape (n, 3), n > 0.
        size: Edge of a cell [mm]; nothing farther than it from a point is found there.
    """
    return cells_within(a, b, np.minimum(a.min(0), b.min(0)) - size,
                        np.maximum(a.max(0), b.max(0)) + size, size)  # fmt: skip
