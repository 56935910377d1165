# SPDX-License-Identifier: Apache-2.0
"""Lines for the places that a pattern leaves too far from any of its lines."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Bools, Floats
from vega_planner.toolpaths.coverage_kernels import distance_to_segments
from vega_planner.toolpaths.isolines import AXIS, CELL, POSITION, Line, isolines, off_levels
from vega_planner.toolpaths.polyline_kernels import middle_line
from vega_planner.toolpaths.segment_cells import cells_within
from vega_planner.toolpaths.surface import Surface

#: A place farther than this from any line, in spacings, gets a line of its own. It is
#: below the half gap that is allowed, since vertices miss the middle of a gap a little.
LONELY = 0.5

#: A line shorter than this, in spacings, is not worth a start and a stop.
_SHORTEST = 1.2


def ridge_vertices(surface: Surface, gradient: Floats) -> Bools:
    """Find the vertices where distances from different sides meet, shape (n,)."""
    a, b = surface.edges[:, 0], surface.edges[:, 1]
    apart = np.einsum("ij,ij->i", gradient[a], gradient[b]) < 0.6
    mask = np.zeros(len(gradient), np.bool_)
    mask[surface.edges[apart].ravel()] = True
    return mask


def lines_in_gaps(
    surface: Surface,
    values: Floats,
    lines: list[Line],
    candidates: Bools,
    levels: Floats,
    spacing: float,
    lonely: float = LONELY,
    shortest: float = _SHORTEST,
) -> list[Line]:
    """Lay lines along the middle of what other lines leave.

    Args:
        surface: Connectivity of the patch.
        values: What to interpolate along the lines, shape (n, 12).
        lines: What is laid already.
        candidates: Vertices that may lie in a gap, shape (n,).
        levels: Field whose whole part becomes the level of the lines, shape (n,).
        spacing: Spacing of the pattern [mm].
        lonely: A place farther than this from any line lies in a gap, in spacings.
        shortest: Shorter lines are left out, in spacings.

    Returns:
        Open lines, each as wide as half the gap it lies in.
    """
    asked = np.flatnonzero(candidates)
    if not len(asked) or not lines:
        return []
    distance = distances_to_lines(surface.vertices[asked], lines, spacing)
    away = np.full(len(surface.vertices), 0.3)
    away[asked] = np.maximum(distance / spacing, 0.3)
    if away.max() <= lonely:
        return []
    values = values.copy()
    values[:, CELL] = np.clip(away, lonely, 1.0) * spacing
    found = []
    for loop in isolines(surface, off_levels(away - lonely), values, 0):
        if not loop.closed:
            continue
        line = middle_of(loop, int(np.floor(levels[loop.above])) + 1, spacing, shortest)
        if line is not None:
            found.append(line)
    return found


def distances_to_lines(points: Floats, lines: list[Line], limit: float) -> Floats:
    """Distance of points from the nearest of some lines, at most `limit`, shape (k,)."""
    starts, ends = [], []
    for line in lines:
        rows = line.rows[:, POSITION]
        starts.append(rows if line.closed else rows[:-1])
        ends.append(np.roll(rows, -1, axis=0) if line.closed else rows[1:])
    a, b = np.concatenate(starts), np.concatenate(ends)
    low, high = points.min(0) - limit, points.max(0) + limit
    near = (np.maximum(a, b) > low).all(1) & (np.minimum(a, b) < high).all(1)
    a, b = a[near], b[near]
    if not len(a):
        return np.full(len(points), limit)
    return distance_to_segments(points, a, b, *cells_within(a, b, low, high, limit))


def middle_of(loop: Line, level: int, spacing: float, shortest: float = _SHORTEST) -> Line | None:
    """Make the line between the two sides of a thin loop; None where it is too short."""
    rows = middle_line(loop.rows)
    rows[:, AXIS] /= np.linalg.norm(rows[:, AXIS], axis=1, keepdims=True)
    if float(np.linalg.norm(rows[-1, POSITION] - rows[0, POSITION])) < shortest * spacing:
        return None
    return Line(rows, level, False, loop.component, loop.above)
