# SPDX-License-Identifier: Apache-2.0
"""Flat layers: walls and concentric infill by exact offsets of the outline.

This is the planar baseline. The outer side of the first wall lies on the outline.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from vega_planner.datatypes import Floats, Patch
from vega_planner.toolpaths.bead import ROUNDING
from vega_planner.toolpaths.isolines import (
    AXIS,
    CELL,
    COLUMNS,
    NORMAL,
    POSITION,
    RIM,
    THICKNESS,
    Line,
)
from vega_planner.toolpaths.polyline_kernels import line_length, middle_line, nearest_on
from vega_planner.toolpaths.surface import Surface

#: Lines end this far inside the outline, in spacings: room for the wall, and for the
#: links that every second end carries.
_LINK_ROOM = 1.35

#: A strip narrower than twice this, in spacings, gets one line instead of two walls.
_TWO_WALLS = 0.65

#: Cosine of the tilt up to which a flat patch counts as printed upright (1 deg): normals at
#: small faces are off by some tenths of a degree where heights are off by a ten-thousandth
#: of a millimetre.
UPRIGHT = 1 - 1.5e-4

#: A blob between walls with more area than this, in spacings squared, gets a bead.
_BLOB = 0.2

#: A point of an outline that is nearer than this to the line past it is left out [mm].
_STRAIGHT = 1e-4

#: Regions whose outlines are nearer than this to each other are the same [mm]; a strip
#: beside walls that is nowhere as deep as this, in spacings, is too thin for a line of its
#: own; outlines are looked at in steps of so many spacings.
_SAME, _THIN, _SAMPLING = 0.01, 0.1, 0.25

#: A loop does not reach out to a place nearer than this [spacings].
_NO_SPIKE = 0.15


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


def region(surface: Surface) -> Any:
    """Make the polygons of a flat patch (shapely geometry)."""
    import shapely

    rings = [shapely.Polygon(loop) for loop in outline(surface)]
    shape: Any = shapely.Polygon()
    for ring in sorted(rings, key=lambda ring: -ring.area):
        if ring.area > 1e-6:
            shape = shape.symmetric_difference(ring.buffer(0))
    return shape


def parallel_lines(
    surface: Surface, patch: Patch, spacing: float, angle_deg: float, *, inside: bool = True
) -> tuple[list[Line], list[Line], list[Line]]:
    """Lay a wall along the outline and straight lines inside it.

    Args:
        surface: Connectivity of the patch.
        patch: A flat patch, normals along z.
        spacing: Distance between lines [mm].
        angle_deg: Direction of the lines about z [deg].
        inside: As for `concentric_lines`.

    Returns:
        The walls, the lines, and the curves that links between lines follow.
    """
    import shapely

    shape = region(surface)
    height = float(patch.vertices[:, 2].mean())
    thickness = float(patch.thickness.mean())
    inset = 0.5 * spacing + (0.5 * ROUNDING * thickness if inside else 0.0)
    walls = [
        _line(ring, True, 0, height, thickness, spacing) for ring in _rings(_offset(shape, -inset))
    ]
    room = _offset(shape, -_LINK_ROOM * spacing)
    if room.is_empty:
        return concentric_lines(surface, patch, spacing, inside=inside), [], []
    guides = [_line(ring, True, 0, height, thickness, spacing) for ring in _rings(room)]
    angle = math.radians(angle_deg)
    along = np.array([math.cos(angle), math.sin(angle)])
    across = np.array([-along[1], along[0]])
    corners = np.asarray(shapely.get_coordinates(_offset(shape, -spacing)))
    low, high = (corners @ across).min(), (corners @ across).max()
    first, last = (corners @ along).min() - 1, (corners @ along).max() + 1
    count = max(1, math.ceil((high - low) / (1.01 * spacing)))
    step = (high - low) / count
    lines = []
    for level in range(count):
        offset = low + (level + 0.5) * step
        cut = shapely.LineString([first * along + offset * across, last * along + offset * across])
        for piece in getattr(cut.intersection(room), "geoms", [cut.intersection(room)]):
            if piece.geom_type == "LineString" and piece.length > 0.5 * spacing:
                points = np.asarray(piece.coords)
                lines.append(_line(points, False, level, height, thickness, step))
    return walls, lines, guides


def _offset(shape: Any, distance: float) -> Any:
    """Grow a region, or shrink it below zero, with sharp corners."""
    # the corner arithmetic divides by zero where edges turn back, and copes with it
    with np.errstate(divide="ignore", invalid="ignore"):
        return shape.buffer(distance, join_style="mitre")


def is_flat(patch: Patch) -> bool:
    """Tell whether a patch is horizontal and printed upright."""
    return bool(np.ptp(patch.vertices[:, 2]) < 1e-3 and patch.tool_axes[:, 2].min() > UPRIGHT)


def concentric_lines(
    surface: Surface, patch: Patch, spacing: float, *, inside: bool = True
) -> list[Line]:
    """Lay loops from the outline inwards, and centre lines where no loop fits.

    Args:
        surface: Connectivity of the patch.
        patch: A flat patch, normals along z.
        spacing: Distance between walls [mm].
        inside: Keep the first wall inside the outline, as the planar baseline does, whose
            outlines have many points: those on straight lines are left out. Else it is
            half a spacing from it, so that its round side stands out as much as it lacks.

    Returns:
        Lines by level, the outermost first.
    """
    shape = region(surface)
    if inside:
        shape = shape.simplify(_STRAIGHT)
    height = float(patch.vertices[:, 2].mean())
    thickness = float(patch.thickness.mean())
    lines: list[Line] = []
    left, level = shape, 0
    # The round side of the first wall touches the outline; what it lacks there, it has
    # too much of towards the second wall.
    inset = 0.5 * spacing + (0.5 * ROUNDING * thickness if inside else 0.0)
    while not left.is_empty:
        # two walls side by side need room; a narrower place gets one line in its middle
        need = max(_TWO_WALLS * spacing, inset)
        wide = _offset(_offset(left, -need), need)
        # overlays of regions whose outlines nearly coincide cost most: only where they matter
        same = inside and _covers(wide, left, _SAME, spacing)
        inner = left if same else wide.intersection(left)
        walls = _offset(inner, -inset)
        strips = []
        if not (same and _covers(walls, left, inset + _THIN * spacing, spacing)):
            covered = walls.buffer(inset + 1e-6)  # round, so that sharp corners cover no more
            strips = [_strip_line(strip, spacing) for strip in _polygons(left.difference(covered))]
        found = [strip for strip in strips if strip is not None]
        rest = _offset(wide, -spacing)
        rings = _rings(walls)
        taken = sum(cell * _length(points, closed) for points, closed, cell in found)
        length = sum(_length(ring, True) for ring in rings)
        cell = (left.area - rest.area - taken) / max(length, 1e-9)
        around = [_line(ring, True, level, height, thickness, cell) for ring in rings]
        for points, closed, width in found:
            line = _line(points, closed, level, height, thickness, width)
            if not (len(points) == 2 and _with_spike(around, line, spacing)):
                lines.append(line)
        lines += around
        left, inset, level = rest, 0.5 * spacing, level + 1
    return lines


def _covers(inner: Any, outer: Any, reach: float, spacing: float) -> bool:
    """Tell whether the outline of a region lies within a distance of another one inside it."""
    import shapely

    around = inner.buffer(reach)
    shapely.prepare(around)
    x, y = shapely.get_coordinates(shapely.segmentize(outer, _SAMPLING * spacing)).T
    return bool(shapely.contains_xy(around, x, y).all())


def _with_spike(around: list[Line], blob: Line, spacing: float) -> bool:
    """Let the nearest loop reach into a corner that a short bead was to fill.

    A bead of half a millimetre is not worth a move there and back. The loop that is
    near enough goes to its middle and back and lays its volume on the way.
    """
    middle = blob.rows.mean(0)
    nearest, at = spacing, (-1, 0, 0.0)
    for n, line in enumerate(around):
        distance, segment, place = nearest_on(line.rows, True, middle)
        if distance < nearest:
            nearest, at = float(distance), (n, int(segment), float(place))
    n, segment, place = at
    if n < 0 or nearest < _NO_SPIKE * spacing:
        return False
    rows = around[n].rows
    foot = (1 - place) * rows[segment] + place * rows[(segment + 1) % len(rows)]
    spike = np.array([foot, middle, foot])
    spike[:, CELL] = blob.rows[0, CELL] * line_length(blob.rows, False) / (2 * nearest)
    spike = np.vstack([foot, spike, foot])
    around[n] = replace(around[n], rows=np.insert(rows, segment + 1, spike, axis=0))
    return True


def _polygons(shape: Any) -> list[Any]:
    parts = getattr(shape, "geoms", [shape])
    return [part for part in parts if part.geom_type == "Polygon" and not part.is_empty]


def _rings(shape: Any) -> list[Floats]:
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
    rows[:, NORMAL] = (0.0, 0.0, 1.0)
    return Line(rows, level, closed, 0)


def _length(points: Floats, closed: bool) -> float:
    return float(line_length(np.column_stack([points, np.zeros(len(points))]), closed))


def _strip_line(strip: Any, spacing: float) -> tuple[Floats, bool, float] | None:
    """Draw a line along a thin strip.

    Returns:
        Points, whether they close, and the mean width of the strip; None where it is
        too small for a line.
    """
    area = strip.area
    if area < 0.15 * spacing**2:
        return None
    if strip.interiors:
        for part in _polygons(_offset(strip, -0.6 * area / strip.length)):
            if part.interiors:
                points = _outer_ring(part)
                return points, True, area / _length(points, True)
    ring = np.asarray(strip.exterior.segmentize(0.25 * spacing).coords)[:-1]
    rows = middle_line(np.column_stack([ring, np.zeros(len(ring))]))
    length = float(line_length(rows, False))
    if length < 1.6 * spacing and area > _BLOB * spacing**2:
        # a corner where walls part: a short bead closes the shaft it would leave
        box = strip.minimum_rotated_rectangle
        sides = np.diff(np.asarray(box.exterior.coords)[:3], axis=0)
        along = sides[np.argmax(np.linalg.norm(sides, axis=1))]
        half = 0.25 * spacing * along / np.linalg.norm(along)
        middle = np.array([strip.centroid.x, strip.centroid.y])
        return np.array([middle - half, middle + half]), False, area / (0.5 * spacing)
    if length < 0.8 * spacing or area / length < 0.25 * spacing:
        return None
    # the ends turn into corners of the strip; the bead's own end reaches that far
    step = np.linalg.norm(np.diff(rows, axis=0), axis=1)
    walked = np.concatenate([[0.0], np.cumsum(step)])
    inner = (walked >= 0.5 * area / length) & (walked <= length - 0.5 * area / length)
    if inner.sum() < 2:
        return None
    points = rows[inner, :2]
    return points, False, area / max(_length(points, False), 1e-9)


def _outer_ring(part: Any) -> Floats:
    return np.asarray(part.exterior.coords)[:-1]
