# SPDX-License-Identifier: Apache-2.0
"""Flat layers: walls and concentric infill by exact offsets of the outline.

This is the planar baseline. The outer side of the first wall lies on the outline.
"""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Floats, Patch
from vega_planner.toolpaths.bead import ROUNDING
from vega_planner.toolpaths.isolines import (
    AXIS,
    CELL,
    COLUMNS,
    POSITION,
    RIM,
    THICKNESS,
    Line,
)
from vega_planner.toolpaths.surface import Surface


def outline(surface: Surface) -> list[Floats]:
    """Chain the rim edges of a flat patch into loops, material to their left.

    Returns:
        Loops of points (k, 2), first point not repeated.
    """
    after = dict(surface.rim_edges.tolist())
    loops = []
    while after:
        start = min(after)
        loop, at = [], start
        while at in after:
            loop.append(at)
            at = after.pop(at)
        if len(loop) > 2:
            loops.append(surface.vertices[loop, :2])
    return loops


def concentric_lines(surface: Surface, patch: Patch, spacing: float) -> list[Line]:
    """Lay loops from the outline inwards, and centre lines where no loop fits.

    Args:
        surface: Connectivity of the patch.
        patch: A flat patch, normals along z.
        spacing: Distance between walls [mm].

    Returns:
        Lines by level, the outermost first.
    """
    import shapely

    rings = [shapely.Polygon(loop) for loop in outline(surface)]
    rings = [ring for ring in rings if ring.area > 1e-6]
    shape = shapely.Polygon()
    for ring in sorted(rings, key=lambda ring: -ring.area):
        shape = shape.symmetric_difference(ring.buffer(0))
    height = float(patch.vertices[:, 2].mean())
    thickness = float(patch.thickness.mean())
    lines: list[Line] = []
    left, level = shape, 0
    # The round side of the first wall touches the outline; what it lacks there, it has
    # too much of towards the second wall.
    inset = 0.5 * spacing + 0.5 * ROUNDING * thickness
    while not left.is_empty:
        middle = left.buffer(-inset, join_style="mitre")
        # what this wall does not reach, nor the next one
        covered = middle.buffer(inset + 1e-6, join_style="mitre")
        for ring in _rings(middle):
            lines.append(_line(ring, True, level, height, thickness, spacing))
        for strip in _polygons(left.difference(covered)):
            row = _centre_line(strip, spacing)
            if row is not None:
                points, cell = row
                lines.append(_line(points, False, level, height, thickness, cell))
        left = left.buffer(-spacing, join_style="mitre")
        inset = 0.5 * spacing
        level += 1
    return lines


def _polygons(shape: object) -> list:
    parts = getattr(shape, "geoms", [shape])
    return [part for part in parts if part.geom_type == "Polygon" and not part.is_empty]


def _rings(shape: object) -> list[Floats]:
    """Outer and inner rings, material to their left."""
    import shapely

    found = []
    for polygon in _polygons(shape):
        polygon = shapely.geometry.polygon.orient(polygon)
        for ring in (polygon.exterior, *polygon.interiors):
            found.append(np.asarray(ring.coords)[:-1])
    return found


def _line(
    points: Floats, closed: bool, level: int, height: float, thickness: float, cell: float
) -> Line:
    rows = np.zeros((len(points), COLUMNS))
    rows[:, POSITION] = np.column_stack([points, np.full(len(points), height)])
    rows[:, AXIS] = (0.0, 0.0, 1.0)
    rows[:, THICKNESS] = thickness
    rows[:, CELL] = cell
    rows[:, RIM] = 0.0
    return Line(rows, level, closed, 0)


def _centre_line(strip: object, spacing: float) -> tuple[Floats, float] | None:
    """Draw a line through a thin strip: its points and the strip's mean width."""
    from vega_planner.toolpaths.polyline_kernels import line_length, middle_line

    area, border = strip.area, strip.length  # type: ignore[attr-defined]
    if area < 0.15 * spacing**2:
        return None
    ring = np.asarray(strip.exterior.segmentize(0.25 * spacing).coords)[:-1]  # type: ignore[attr-defined]
    ring = np.column_stack([ring, np.zeros(len(ring))])
    rows = middle_line(ring)
    length = float(line_length(rows, False))
    if length < 0.3 * spacing or border < spacing:
        return None
    return rows[:, :2], area / length
