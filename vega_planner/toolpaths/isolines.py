# SPDX-License-Identifier: Apache-2.0
"""Lines of equal value on a patch, with everything a bead needs along them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vega_planner.datatypes import Floats, Ints, Patch
from vega_planner.part.surface_kernels import vertex_normals
from vega_planner.toolpaths.corner_kernels import with_corners
from vega_planner.toolpaths.isoline_kernels import gather, trace_isolines
from vega_planner.toolpaths.surface import Surface

#: Columns of a row of a line: position, tool axis, layer thickness, width of the strip
#: to fill, distance from the rim, normal of the surface.
POSITION, AXIS, THICKNESS, CELL, RIM = slice(0, 3), slice(3, 6), 6, 7, 8
NORMAL = slice(9, 12)
COLUMNS = 12

#: A vertex this near a level (as part of the spacing) is moved off it, so that a line
#: never runs through a vertex.
_OFF_LEVEL = 1e-7

#: The place outside a loop's corner is no farther from it and the next loop than this, in
#: spacings; less sharp corners than this [rad] leave no such place.
_WIDEST, _SHARP = 0.545, 0.7


@dataclass(frozen=True, eq=False)
class Line:
    """One line on a patch.

    Attributes:
        rows: Position, axis, thickness, width to fill, distance from the rim, shape
            (n, 12); a closed line does not repeat its first row.
        level: Number of the isoline it is.
        closed: True for a loop.
        component: Connected piece of the patch it lies on.
        above: A vertex on its higher side.
    """

    rows: Floats
    level: int
    closed: bool
    component: int
    above: int = -1


def off_levels(field: Floats) -> Floats:
    """Move values that are whole numbers a little up.

    Args:
        field: Values in units of the spacing, shape (n,).
    """
    near = np.abs(field - np.round(field)) < _OFF_LEVEL
    return np.where(near, np.round(field) + 2 * _OFF_LEVEL, field)


def isolines(surface: Surface, field: Floats, values: Floats, top: int) -> list[Line]:
    """Find the lines field = 0, 1, ... top.

    Args:
        surface: The patch.
        field: Values at the vertices, none a whole number, shape (n,).
        values: What to interpolate along the lines, shape (n, 12).
        top: Highest level.

    Returns:
        The lines by level, higher values on their left.
    """
    where, place, level, begin, closed = trace_isolines(
        surface.edges, surface.face_edges, field, top
    )
    rows = gather(surface.edges, where, place, values)
    ends = surface.edges[where]
    lines: list[Line] = []
    for n in range(len(closed)):
        a, b = begin[n], begin[n + 1]
        if b - a < 2:
            continue
        i, j = ends[a]
        above = int(i if field[i] > field[j] else j)
        lines.append(
            Line(rows[a:b], int(level[a]), bool(closed[n]), int(surface.component[above]), above)
        )
    lines.sort(key=lambda line: line.level)
    return lines


def cornered(lines: list[Line], spacing: float) -> list[Line]:
    """Draw the blunt corners of loops out, so that what lies outside them is covered.

    Args:
        lines: Loops `spacing` apart, inside to their left; open lines are left alone.
        spacing: Distance between them [mm].
    """
    return [
        replace(
            line, rows=with_corners(line.rows, NORMAL.start, spacing, _WIDEST * spacing, _SHARP)
        )
        if line.closed
        else line
        for line in lines
    ]


def vertex_values(patch: Patch, cell: Floats | float, rim_distance: Floats) -> Floats:
    """Put what is interpolated along a line side by side, shape (n, 12)."""
    values = np.empty((len(patch.vertices), COLUMNS))
    values[:, POSITION] = patch.vertices
    values[:, AXIS] = patch.tool_axes
    values[:, THICKNESS] = patch.thickness
    values[:, CELL] = cell
    values[:, RIM] = rim_distance
    values[:, NORMAL] = vertex_normals(patch.vertices, patch.faces)
    return values


def levels_of(field: Floats) -> Ints:
    """Number of the highest line at or below each value; -1 below the first."""
    return np.maximum(np.floor(field), -1).astype(np.int64)
