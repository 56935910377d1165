# SPDX-License-Identifier: Apache-2.0
"""Zigzag pattern: a loop along the rim, and parallel lines inside it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from vega_planner.datatypes import Floats, Patch
from vega_planner.toolpaths.contour import contour_lines
from vega_planner.toolpaths.distance import from_guide
from vega_planner.toolpaths.isolines import (
    CELL,
    RIM,
    Line,
    cornered,
    isolines,
    off_levels,
    vertex_values,
)
from vega_planner.toolpaths.polyline_kernels import keep_inside, line_length
from vega_planner.toolpaths.rim import Ground, measure_rim
from vega_planner.toolpaths.surface import Surface

#: Room of a line to the rim, in spacings: along the rim it may touch the rim's loop,
#: straight at it half a spacing is left for the links between lines.
_ALONG, _ACROSS = 1.05, 1.5


def guide_field(surface: Surface, patch: Patch, angle_deg: float) -> Floats:
    """Make a field whose zero line is the guide curve of each piece.

    The curve is the cut with a vertical plane through the middle of the piece, along
    the wanted direction; a piece that lies in that plane is cut across instead.

    Args:
        surface: Connectivity of the patch.
        patch: The patch.
        angle_deg: Direction of the lines about z [deg].

    Returns:
        Signed distance from the plane [mm], shape (n,).
    """
    angle = math.radians(angle_deg)
    across = np.array([-math.sin(angle), math.cos(angle), 0.0])
    along = np.array([math.cos(angle), math.sin(angle), 0.0])
    field = np.empty(len(surface.vertices))
    for piece in range(surface.component_count):
        members = surface.component == piece
        points = surface.vertices[members]
        spread = [np.ptp(points @ axis) for axis in (across, along)]
        use = across
        if spread[0] < 0.2 * spread[1]:
            use = np.array([0.0, 0.0, 1.0]) if np.ptp(points[:, 2]) > spread[0] else across
        value = surface.vertices @ use
        field[members] = (value - 0.5 * (value[members].min() + value[members].max()))[members]
    return field


@dataclass(frozen=True, eq=False)
class Zigzag:
    """Lines of a patch before they are linked.

    Attributes:
        loops: Loops along the rim.
        lines: The lines inside.
        guides: Curves that links between lines follow.
        values: What the lines carry, at the vertices, shape (n, 12).
    """

    loops: list[Line]
    lines: list[Line]
    guides: list[Line]
    values: Floats


def zigzag_lines(
    surface: Surface,
    patch: Patch,
    spacing: float,
    angle_deg: float,
    *,
    ground: Ground | None = None,
    euclidean: bool = False,
) -> Zigzag:
    """Lay a loop along the rim and parallel lines inside it.

    Args:
        surface: Connectivity of the patch.
        patch: The patch.
        spacing: Wanted spacing [mm].
        angle_deg: Direction of the lines about z [deg].
        ground: As for `contour_lines`.
        euclidean: Keep the distance between parallel planes, not on the surface.
    """
    loops: list[Line] = []
    guides: list[Line] = []
    has_rim = len(surface.rim_edges) > 0
    room = np.full(len(surface.vertices), 3 * spacing)
    if has_rim:
        rim = measure_rim(surface, patch, spacing, ground, limit=3 * spacing)
        room = np.minimum(rim.distance - rim.filled + spacing, room)
        if float(room.max()) < 1.6 * spacing:
            narrow, _ = contour_lines(surface, patch, spacing, ground=ground)
            return Zigzag(narrow, [], [], vertex_values(patch, spacing, room))
        levels = off_levels(np.minimum(rim.levels(spacing), 3.0))
        values = vertex_values(patch, rim.cells(spacing), room)
        loops = cornered(isolines(surface, levels, values, 0), spacing)
        guides = isolines(surface, off_levels(room / spacing - _ACROSS), values, 0)
    guide = guide_field(surface, patch, angle_deg)
    distance = guide if euclidean else from_guide(surface, guide)
    values = vertex_values(patch, spacing, room)
    lines: list[Line] = []
    start = 0
    for piece in range(surface.component_count):
        members = surface.component == piece
        margin = spacing if has_rim else 0.0
        low, high = float(distance[members].min()), float(distance[members].max())
        depth = max(high - low - 2 * margin, 0.0)
        count = max(1, math.ceil(depth / (1.01 * spacing)))
        step = spacing if euclidean else max(depth / count, 0.8 * spacing)
        field = np.where(members, (distance - low - margin) / step - 0.5, -1.0)
        found = isolines(surface, off_levels(field), values, math.ceil(field.max()))
        for line in found:
            rows = line.rows
            rows[:, CELL] = step
            lines += _inside(replace(line, level=line.level + start), spacing, has_rim)
        start += count + 2
    return Zigzag(loops, lines, guides, values)


def _inside(line: Line, spacing: float, has_rim: bool) -> list[Line]:
    """Keep the parts of a line that leave room for the rim's loop."""
    if not has_rim:
        return [line]
    rows = line.rows
    pieces = keep_inside(rows, line.closed, RIM, spacing, _ALONG, _ACROSS)
    if line.closed and len(pieces) == 1 and pieces[0, 1] - pieces[0, 0] + 1 == len(rows):
        return [line]
    kept = []
    for first, last, before, after in pieces:
        i, j = int(first), int(last)
        part = [rows[i : j + 1]]
        if before > 0:
            part.insert(0, rows[i : i + 1] + before * (rows[i - 1 : i] - rows[i : i + 1]))
        if after > 0:
            part.append(rows[j : j + 1] + after * (rows[j + 1 : j + 2] - rows[j : j + 1]))
        new = np.concatenate(part)
        if len(new) >= 2 and line_length(new, False) > 1.5 * spacing:
            kept.append(replace(line, rows=new, closed=False))
    return kept
