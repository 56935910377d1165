# SPDX-License-Identifier: Apache-2.0
"""What RViz shows of a plan: a namespace for each layer, lines for the passes."""

from __future__ import annotations

import colorsys

import numpy as np

from vega_planner.datatypes import (
    REASON_CODES,
    Floats,
    LayerStack,
    PrintabilityReport,
    ToolpathSet,
    TriangleGeometry,
)
from vega_planner.nodes.cdr import LINE_STRIP, TRIANGLE_LIST, ShapeMarker
from vega_planner.units import mm_to_m

#: Most points of one line: RViz leaves a gap and wastes memory above 16,384.
MOST_LINE_POINTS = 10_000
_RESTRAINT = (0.95, 0.75, 0.1, 1.0)
_UNPRINTABLE = (0.9, 0.1, 0.1, 1.0)


def layer_markers(
    stack: LayerStack, report: PrintabilityReport | None = None
) -> list[ShapeMarker]:
    """Show layers as triangles, the restraint region, and what cannot be printed and why.

    Args:
        stack: The layers.
        report: Outcome of the printability filters, where there is one.
    """
    sheets = stack.sheets
    markers = [
        _triangles(f"layer_{index:03d}", index, sheet, layer_color(index, len(sheets)))
        for index, sheet in enumerate(sheets)
        if len(sheet.faces)
    ]
    part = stack.part
    if part.restrained.any():
        region = part.vertices[part.faces[part.restrained]].reshape(-1, 3)
        markers.append(_shape("restraint", 0, TRIANGLE_LIST, region, _RESTRAINT))
    for index, reasons in enumerate(report.face_reasons if report else ()):
        for code in np.unique(reasons[reasons > 0]):
            sheet = sheets[index]
            # Lifted a little along the normal, so that it does not fight the layer it is on.
            corners = sheet.vertices[sheet.faces[reasons == code]]
            corners = corners + 0.05 * sheet.face_normals[reasons == code][:, None]
            name = f"unprintable_{REASON_CODES[code - 1]}"
            points = corners.reshape(-1, 3)
            markers.append(_shape(name, index, TRIANGLE_LIST, points, _UNPRINTABLE))
    return markers


def toolpath_markers(toolpaths: ToolpathSet) -> list[ShapeMarker]:
    """Show the passes of each layer as lines of the beads' width, and the travel moves."""
    layers = max((path.layer for path in toolpaths.passes), default=0) + 1
    markers, counts = [], dict.fromkeys(range(layers), 0)
    for path in toolpaths.passes:
        name, color = f"layer_{path.layer:03d}", layer_color(path.layer, layers)
        for piece in line_pieces(path.points):
            width = float(mm_to_m(path.width.mean()))
            number = counts[path.layer]
            markers.append(_shape(name, number, LINE_STRIP, piece, color, width))
            counts[path.layer] += 1
    number = 0
    for move in toolpaths.travels:
        if len(move.points) < 2:
            continue
        for piece in line_pieces(move.points):
            markers.append(_shape("travel", number, LINE_STRIP, piece, (0.6, 0.6, 0.6, 0.6), 2e-4))
            number += 1
    return markers


def line_pieces(points: Floats) -> list[Floats]:
    """Cut a line into pieces that RViz draws without gaps; ends are shared."""
    step = MOST_LINE_POINTS - 1
    starts = range(0, max(len(points) - 1, 1), step)
    return [points[start : start + MOST_LINE_POINTS] for start in starts]


def layer_color(index: int, count: int) -> tuple[float, float, float, float]:
    """Colour layers from blue (outermost) to orange, alternately light and dark."""
    hue = 0.6 - 0.52 * index / max(count - 1, 1)
    red, green, blue = colorsys.hsv_to_rgb(hue, 0.65, 0.95 if index % 2 == 0 else 0.75)
    return red, green, blue, 1.0


def _triangles(
    name: str, number: int, mesh: TriangleGeometry, color: tuple[float, float, float, float]
) -> ShapeMarker:
    return _shape(name, number, TRIANGLE_LIST, mesh.vertices[mesh.faces].reshape(-1, 3), color)


def _shape(
    name: str,
    number: int,
    kind: int,
    points_mm: Floats,
    color: tuple[float, float, float, float],
    width: float = 0.0,
) -> ShapeMarker:
    return ShapeMarker(name, number, kind, mm_to_m(points_mm), color, "part", width)
