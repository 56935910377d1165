# SPDX-License-Identifier: Apache-2.0
"""Contour pattern: loops at equal distances from the rim, inwards."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints, Patch
from vega_planner.part.surface_kernels import label_components
from vega_planner.toolpaths.distance import through_space_from_rim
from vega_planner.toolpaths.gaps import LONELY, lines_in_gaps, middle_of, ridge_vertices
from vega_planner.toolpaths.isoline_kernels import area_above
from vega_planner.toolpaths.isolines import (
    CELL,
    Line,
    cornered,
    isolines,
    levels_of,
    off_levels,
    vertex_values,
)
from vega_planner.toolpaths.polyline_kernels import line_length
from vega_planner.toolpaths.rim import Ground, measure_rim
from vega_planner.toolpaths.surface import Surface

#: The spacing is fitted to the depth of the patch between these parts of itself; where
#: that cannot be, the middle gets a line of its own.
_CLOSEST, _WIDEST = 0.9, 1.01


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
    lines = cornered(isolines(surface, field, values, math.floor(field.max())), fitted)
    ridge = ridge_vertices(surface, rim.gradient)
    return _fill_middles(surface, field, values, lines, ridge, fitted), fitted


def _fill_middles(
    surface: Surface,
    field: Floats,
    values: Floats,
    lines: list[Line],
    ridge: Bools,
    spacing: float,
) -> list[Line]:
    """Let the last loops, and lines between them, fill what lies inside them."""
    levels = levels_of(field)
    region, count = label_components(surface.edges, levels, len(levels))
    top, level = _region_tops(surface, field, levels, region, count)
    middle = top > -1
    base = np.where(middle, np.maximum(level, -0.5), 1e9)
    area = area_above(surface.vertices, surface.faces, field, base, region, count)
    wide = ridge & (field - levels > 0.5) & (levels >= 0)
    ridges = lines_in_gaps(surface, values, lines, wide, field, spacing)
    ridges += _strips(surface, field, values, region, middle & (level < 0), top, spacing)
    for line in ridges:
        part = line.rows[:, CELL].mean() * line_length(line.rows, False)
        area[region[line.above]] -= part
    around, loops = np.zeros(count), np.zeros(count)
    owner = [int(region[line.above]) for line in lines]
    inner = [middle[r] and level[r] == line.level for r, line in zip(owner, lines)]
    for r, line, last in zip(owner, lines, inner):
        if last:
            around[r] += line_length(line.rows, line.closed)
            loops[r] += 1
    result = []
    for r, line, last in zip(owner, lines, inner):
        if last:
            # a strip outside a single small loop is longer than the loop (Steiner)
            outside = max(0.0, 2.0 - loops[r]) * math.pi * spacing**2 / 4
            rows = line.rows.copy()
            rows[:, CELL] += (max(area[r], 0.0) + outside) / around[r] - 0.5 * spacing
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
    return np.where(passed, -1.0, top), level


def _strips(
    surface: Surface,
    field: Floats,
    values: Floats,
    region: Ints,
    narrow: Bools,
    top: Floats,
    spacing: float,
) -> list[Line]:
    """Draw a line along the middle of each region that is too narrow for a loop."""
    reach = np.where(narrow, top + 0.5, 0.0)
    narrow = narrow & (reach > 0.5 * LONELY)
    if not narrow.any():
        return []
    part = np.where(narrow[region], (field + 0.5) / np.maximum(reach, 1e-9)[region], -1.0)
    lines = []
    for loop in isolines(surface, off_levels(part - 0.75), values, 0):
        line = middle_of(loop, 0, spacing) if loop.closed else None
        if line is not None:
            line.rows[:, CELL] = 2.0 * reach[region[loop.above]] * spacing
            lines.append(line)
    return lines
