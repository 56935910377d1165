# SPDX-License-Identifier: Apache-2.0
"""Short lines in the wedges that parallel lines leave beside the loop along a rim."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Floats, Ints
from vega_planner.toolpaths.carrier import Carrier
from vega_planner.toolpaths.coverage_kernels import (
    distance_to_segments,
    gaps_beside,
)
from vega_planner.toolpaths.gaps import lines_in_gaps
from vega_planner.toolpaths.isolines import AXIS, POSITION, RIM, Line
from vega_planner.toolpaths.linking import Pass
from vega_planner.toolpaths.polyline_kernels import line_length
from vega_planner.toolpaths.segment_cells import cells_around
from vega_planner.toolpaths.surface import Surface

#: A strip between this and that wide, in spacings, is a wedge; where it is wider there is
#: a line in it.
_NARROW, _BROAD = 1.06, 2.3

#: Nearer than this, in spacings, a pass is taken for a piece of the loop itself.
_SAME = 0.3

#: A place farther than this from all passes lies in a hole that no end of a line can be
#: bent into; a line that fills it is at least so long, in spacings.
_LONELY, _STUB = 0.58, 0.2

#: The loop is looked at in steps of this [spacings].
_STEP = 0.25

#: A shorter line is not laid [spacings].
_SHORTEST = 0.2


def wedge_lines(
    loops: list[Line], passes: list[Pass], carrier: Carrier, spacing: float
) -> list[Line]:
    """Lay lines along the middle of the wedges inside loops.

    Args:
        loops: Loops along the rim, inside to their left.
        passes: What is laid, the loops among it.
        carrier: What lines carry on the patch.
        spacing: Spacing of the lines [mm].

    Returns:
        Open lines, each as wide as half the wedge it lies in.
    """
    loops = [loop for loop in loops if loop.closed]
    if not loops or not passes:
        return []
    rims = [_finely(loop.rows, _STEP * spacing) for loop in loops]
    count = sum(len(rim) for rim in rims)
    ends = [(rim, np.roll(rim, -1, axis=0)) for rim in rims]
    for item in passes:
        near = np.minimum(item.rows[:-1, RIM], item.rows[1:, RIM]) < (_BROAD + 0.6) * spacing
        ends.append((item.rows[:-1][near], item.rows[1:][near]))
    a = np.concatenate([start[:, POSITION] for start, _ in ends])
    b = np.concatenate([end[:, POSITION] for _, end in ends])
    axes = np.concatenate([start[:, AXIS] for start, _ in ends])
    size = _BROAD * spacing
    cells = cells_around(a, b, size)
    gaps, ways = gaps_beside(a, b, axes, *cells, _SAME * spacing, size)
    gap, way = gaps[:count, 0], ways[:count, 0]
    middle = 0.5 * (a[:count] + b[:count] + way)
    wide = gap > _NARROW * spacing
    bare = np.zeros(count)
    bare[wide] = distance_to_segments(middle[wide], a, b, *cells)
    wide &= 2.0 * bare > _NARROW * spacing
    if not wide.any():
        return []
    lines = []
    first = 0
    for loop, rim in zip(loops, rims):
        rows = slice(first, first + len(rim))
        first = rows.stop
        for run in _runs(wide[rows]):
            at = rows.start + run
            line = carrier.rows(middle[at], bare[at])
            if len(line) > 1 and line_length(line, False) >= _SHORTEST * spacing:
                lines.append(Line(line, 0, False, loop.component))
    return lines


def corner_lines(
    surface: Surface, values: Floats, passes: list[Pass], spacing: float
) -> list[Line]:
    """Lay lines where a corner of the rim is too narrow for a line of the pattern.

    Args:
        surface: Connectivity of the patch.
        values: What lines carry, at the vertices, shape (n, 12).
        passes: What is laid.
        spacing: Spacing of the lines [mm].

    Returns:
        Open lines, each as wide as half the gap it lies in.
    """
    room = values[:, RIM]
    beside = (room > spacing) & (room < (_BROAD + 0.6) * spacing)
    laid = [Line(item.rows, 0, False, 0) for item in passes]
    level = np.zeros(len(values))
    return lines_in_gaps(surface, values, laid, beside, level, spacing, _LONELY, _STUB)


def _finely(rows: Floats, step: float) -> Floats:
    """Points of a loop, with more of them between those farther apart than a step."""
    after = np.roll(rows, -1, axis=0)
    length = np.linalg.norm(after[:, POSITION] - rows[:, POSITION], axis=1)
    pieces = np.maximum(np.ceil(length / step), 1).astype(int)
    segment = np.repeat(np.arange(len(rows)), pieces)
    within = np.arange(len(segment)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    part = (within / pieces[segment])[:, None]
    return np.asarray((1.0 - part) * rows[segment] + part * after[segment])


def _runs(mask: np.ndarray) -> list[Ints]:
    """Indices of each run of True round a loop, in order."""
    n = len(mask)
    if mask.all():
        return [np.arange(n)]
    start = int(np.flatnonzero(~mask)[0])
    order = (np.arange(n) + start) % n
    on = np.flatnonzero(mask[order])
    return [order[run] for run in np.split(on, np.flatnonzero(np.diff(on) > 1) + 1) if len(run)]
