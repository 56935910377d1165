# SPDX-License-Identifier: Apache-2.0
"""What RViz shows of a plan: a namespace for each layer, lines for the passes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vega_planner.datatypes import (
    REASON_CODES,
    Floats,
    Ints,
    LayerStack,
    PrintabilityReport,
    ToolpathSet,
    TriangleGeometry,
)
from vega_planner.nodes.cdr import LINE_STRIP, TRIANGLE_LIST, ShapeMarker
from vega_planner.units import mm_to_m
from vega_planner.viewer.colours import (
    REASON_COLOURS,
    RESTRAINT,
    Colour,
    layer_colour,
    speed_colours,
)

#: Most points of one line: RViz leaves a gap and wastes memory above 16,384.
MOST_LINE_POINTS = 10_000
#: Reasons that are collisions; the others are limits of reach and support.
COLLISIONS = ("own_layer", "printed_part", "plate", "substrate", "robot_body")
#: How far marks stand off the layer they are on, so that the two do not fight [mm].
_LIFT_MM = 0.05
_TRAVEL = (0.6, 0.6, 0.6, 0.6)

Rgba = tuple[float, float, float, float]


def layer_markers(
    stack: LayerStack, report: PrintabilityReport | None = None
) -> list[ShapeMarker]:
    """Show layers as triangles, the restraint region, and what cannot be printed and why.

    Args:
        stack: The layers.
        report: Outcome of the printability filters, where there is one.

    Returns:
        Namespaces `layer_NNN`, `restraint`, and `collision_REASON` or
        `unprintable_REASON`, in the part frame.
    """
    sheets = stack.sheets
    markers = [
        _triangles(f"layer_{index:03d}", index, sheet, layer_color(index, len(sheets)))
        for index, sheet in enumerate(sheets)
        if len(sheet.faces)
    ]
    part = stack.part
    if part.restrained.any():
        region = part.vertices[part.faces[part.restrained]]
        lifted = region + _LIFT_MM * part.face_normals[part.restrained][:, None]
        points = mm_to_m(lifted.reshape(-1, 3))
        markers.append(_shape("restraint", 0, TRIANGLE_LIST, points, _rgba(RESTRAINT)))
    for index, (sheet, reasons) in enumerate(zip(sheets, report.face_reasons if report else ())):
        markers += _unprintable(index, sheet, reasons)
    return markers


def _unprintable(index: int, sheet: TriangleGeometry, reasons: Ints) -> list[ShapeMarker]:
    markers = []
    for code in np.unique(reasons[reasons > 0]):
        corners = sheet.vertices[sheet.faces[reasons == code]]
        corners = corners + _LIFT_MM * sheet.face_normals[reasons == code][:, None]
        reason = REASON_CODES[code - 1]
        name = f"{'collision' if reason in COLLISIONS else 'unprintable'}_{reason}"
        points, color = mm_to_m(corners.reshape(-1, 3)), _rgba(REASON_COLOURS[reason])
        markers.append(_shape(name, index, TRIANGLE_LIST, points, color))
    return markers


def toolpath_markers(
    toolpaths: ToolpathSet, speeds: Sequence[Floats] | None = None
) -> list[ShapeMarker]:
    """Show the passes as lines of the beads' width, and the travel moves.

    Args:
        toolpaths: The passes.
        speeds: Speed of the tip at the points of each pass, to colour by; by layer when
            absent.

    Returns:
        Namespaces `layer_NNN` and `travel`, in the part frame.
    """
    passes = toolpaths.passes
    layers = max((path.layer for path in passes), default=0) + 1
    coloured: list[Floats | None] = [None] * len(passes)
    if speeds:
        every = np.concatenate(speeds)
        shades = speed_colours(every, np.ones(len(every), bool))
        opaque = np.column_stack([shades / 255.0, np.ones(len(every))]).astype(np.float32)
        ends = np.cumsum([len(one) for one in speeds])[:-1]
        coloured = list(np.split(opaque, ends))
    markers, counts = [], dict.fromkeys(range(layers), 0)
    for path, shade in zip(passes, coloured, strict=True):
        name, color = f"layer_{path.layer:03d}", layer_color(path.layer, layers)
        width, points = float(mm_to_m(path.width.mean())), mm_to_m(path.points)
        for piece in line_pieces(len(points)):
            colors = None if shade is None else shade[piece]
            number = counts[path.layer]
            markers.append(_shape(name, number, LINE_STRIP, points[piece], color, width, colors))
            counts[path.layer] += 1
    number = 0
    for move in toolpaths.travels:
        if len(move.points) < 2:
            continue
        points = mm_to_m(move.points)
        for piece in line_pieces(len(points)):
            markers.append(_shape("travel", number, LINE_STRIP, points[piece], _TRAVEL, 2e-4))
            number += 1
    return markers


def line_pieces(count: int, most: int = MOST_LINE_POINTS) -> list[slice]:
    """Cut a line of so many points into pieces that RViz draws without gaps; ends are shared."""
    return [slice(start, start + most) for start in range(0, max(count - 1, 1), most - 1)]


def layer_color(index: int, count: int) -> Rgba:
    """Colour of a layer, as in the browser, the odd ones darker so that they stand apart."""
    red, green, blue, _ = _rgba(layer_colour(index, count))
    shade = 1.0 if index % 2 == 0 else 0.8
    return shade * red, shade * green, shade * blue, 1.0


def _rgba(colour: Colour) -> Rgba:
    red, green, blue = colour
    return red / 255, green / 255, blue / 255, 1.0


def _triangles(name: str, number: int, mesh: TriangleGeometry, color: Rgba) -> ShapeMarker:
    points = np.take(mm_to_m(mesh.vertices), mesh.faces.ravel(), axis=0)
    return _shape(name, number, TRIANGLE_LIST, points, color)


def _shape(
    name: str,
    number: int,
    kind: int,
    points: Floats,
    color: Rgba,
    width: float = 0.0,
    colors: Floats | None = None,
) -> ShapeMarker:
    return ShapeMarker(name, number, kind, points, color, "part", width, colors)
