# SPDX-License-Identifier: Apache-2.0
"""Contour pattern: loops at equal distances from the rim, inwards."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints, Patch
from vega_planner.toolpaths.distance import through_space_from_rim
from vega_planner.toolpaths.isoline_kernels import area_above
from vega_planner.toolpaths.isolines import (
    AXIS,
    CELL,
    POSITION,
    Line,
    isolines,
    levels_of,
    off_levels,
    vertex_values,
)
from vega_planner.toolpaths.polyline_kernels import line_length, middle_line
from vega_planner.toolpaths.rim import Ground, measure_rim
from vega_planner.toolpaths.surface import Surface
from vega_planner.toolpaths.topology_kernels import label_components

#: The spacing is fitted to the depth of the patch between these parts of itself; where
#: that cannot be, the middle gets a line of its own.
_CLOSEST, _WIDEST = 0.9, 1.01

#: A middle wider than this part of the spacing, from the last loop to the ridge, gets
#: a line of its own.
_LONE_RIDGE = 0.55


def fitted_spacing(depth: float, spacing: float) -> float:
    """Fit the spacing so that whole strips fill a depth.

    Args:
        depth: Largest distance from the rim [mm].
        spacing: Wanted spacing [mm].

    Returns:
        Spacing of which `depth` is a multiple, or `spacing` where none is near.
    """
    if depth <= 0:
        return spacing
    count = max(1, math.ceil(depth / (_WIDEST * spacing)))
    fitted = depth / count
    return fitted if fitted >= _CLOSEST * spacing else spacing


def contour_lines(
    surface: Surface,
    patch: Patch,
    spacing: float,
    *,
    ground: Ground | None = None,
    euclidean: bool = False,
) -> tuple[list[Line], float]:
    """Lay loops on a patch, from half a spacing inside the rim to its middle.

    Args:
        surface: Connectivity of the patch.
        patch: The patch.
        spacing: Wanted spacing [mm].
        ground: What the rim may stand on; nothing when absent.
        euclidean: Measure the distance from the rim through space.

    Returns:
        The lines by level, with the width of the strip each has to fill, and the
        spacing that was used [mm].
    """
    if euclidean:
        distance = through_space_from_rim(surface, spacing)
        field = off_levels(distance / spacing - 0.5)
        values = vertex_values(patch, spacing, distance)
        return isolines(surface, field, values, math.floor(field.max())), spacing
    rim = measure_rim(surface, patch, spacing, ground)
    fitted = fitted_spacing(rim.depth, spacing)
    field = off_levels(rim.levels(fitted))
    values = vertex_values(patch, rim.cells(fitted), rim.distance)
    lines = isolines(surface, field, values, math.floor(field.max()))
    return _fill_middles(surface, field, values, lines, fitted), fitted


def _fill_middles(
    surface: Surface, field: Floats, values: Floats, lines: list[Line], spacing: float
) -> list[Line]:
    """Let the last loops, or a line between them, fill what lies inside them."""
    levels = levels_of(field)
    region, count = label_components(surface.edges, levels, len(levels))
    top, level = _region_tops(surface, field, levels, region, count)
    middle = top >= 0
    reach = np.where(middle, top - np.maximum(level, -0.5), 0.0)
    area = area_above(
        surface.vertices,
        surface.faces,
        field,
        np.where(middle, np.maximum(level, -0.5), 1e9),
        region,
        count,
    )
    lone = reach > np.where(level < 0, 0.5 * _LONE_RIDGE, _LONE_RIDGE)
    ridges = _ridge_lines(surface, field, values, region, lone, reach, level, spacing)
    around, loops = np.zeros(count), np.zeros(count)
    length = np.array([line_length(line.rows, line.closed) for line in lines])
    owner = np.array([region[line.above] for line in lines], np.int64)
    inner = np.array([level[r] == line.level and middle[r] for r, line in zip(owner, lines)])
    for n in np.flatnonzero(inner).tolist():
        around[owner[n]] += length[n]
        loops[owner[n]] += 1
    result = []
    for n, line in enumerate(lines):
        if inner[n]:
            inside = area[owner[n]] * (0.5 if lone[owner[n]] else 1.0)
            # a strip outside a single small loop is longer than the loop (Steiner)
            outside = max(0.0, 2.0 - loops[owner[n]]) * math.pi * spacing**2 / 4
            rows = line.rows.copy()
            rows[:, CELL] += (inside + outside) / around[owner[n]] - 0.5 * spacing
            line = replace(line, rows=rows)
        result.append(line)
    result += ridges
    result.sort(key=lambda line: line.level)
    return result


def _region_tops(
    surface: Surface, field: Floats, levels: Ints, region: Ints, count: int
) -> tuple[Floats, Floats]:
    """Highest value of each region that no higher one touches (else -1), and its level."""
    top = np.full(count, -1.0)
    np.maximum.at(top, region, field)
    level = np.zeros(count)
    level[region] = levels
    a, b = surface.edges[:, 0], surface.edges[:, 1]
    lower = np.where(levels[a] < levels[b], a, b)
    passed = np.zeros(count, np.bool_)
    passed[region[lower[levels[a] != levels[b]]]] = True
    return np.where(passed, -1.0, np.where(level < 0, np.maximum(top, 0.0), top)), level


def _ridge_lines(
    surface: Surface,
    field: Floats,
    values: Floats,
    region: Ints,
    lone: Bools,
    reach: Floats,
    level: Floats,
    spacing: float,
) -> list[Line]:
    """Draw a line along the ridge of each region that is wide enough for one."""
    if not lone.any():
        return []
    part = np.where(
        lone[region],
        (field - np.maximum(level, -0.5)[region]) / np.maximum(reach, 1e-9)[region],
        -1.0,
    )
    lines = []
    for loop in isolines(surface, off_levels(part - 0.75), values, 0):
        here = region[loop.above]
        if not loop.closed or not lone[here]:
            continue
        rows = middle_line(loop.rows)
        rows[:, AXIS] /= np.linalg.norm(rows[:, AXIS], axis=1, keepdims=True)
        if np.linalg.norm(rows[-1, POSITION] - rows[0, POSITION]) < 0.3 * spacing:
            continue
        rows[:, CELL] = reach[here] * spacing * (2.0 if level[here] < 0 else 1.0)
        lines.append(Line(rows, int(level[here]) + 1, False, loop.component, loop.above))
    return lines
