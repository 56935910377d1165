# SPDX-License-Identifier: Apache-2.0
"""Printability filters over all layers: reach (f1), line of sight (f2), solid tool (f2s).

Each vertex of each sheet is judged twice: with the nozzle on the outer side of the layer
(the side its normals point to) and on its inner side, as a bowl is printed. On the outer
side the tool meets the plate, the substrate and the material of deeper layers, which is
printed before; on the inner side the plate, the substrate and what outer layers have laid
from their inner side.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from vega_planner.datatypes import (
    REASON_CODES,
    Bools,
    Floats,
    Ints,
    Layer,
    LayerStack,
    PrintabilityReport,
)
from vega_planner.parallel import map_threads
from vega_planner.part.topology import connected_pieces
from vega_planner.printability.line_of_sight import Occluder
from vega_planner.printability.material import EMPTY, DistanceField, Material, mesh_field
from vega_planner.printability.orientation import orient, tilt_of
from vega_planner.printability.report import summarised
from vega_planner.printability.sides import (
    INSIDE,
    NEITHER,
    SheetAssessment,
    Side,
    face_labels,
    with_hope,
    with_hope_inside,
    without_noise,
)
from vega_planner.printability.tool_shape import ToolShape
from vega_planner.progress import Progress, Report
from vega_planner.settings import PrintabilitySettings

if TYPE_CHECKING:
    from vega_planner.robot.workcell import Workcell

#: Against its own layer the tool counts from here on [mm]: nearer the tip the layer is
#: what the tool stands on.
OWN_LAYER_MM = 6.0

#: Bead width over layer thickness, where only the layer is known; the paper's.
WIDTH_RATIO = 1.5

#: Downward share of the normal from which on a face lies on the substrate or the layer
#: under it, and from which on it lies on the plate. (The foot of a leaning wall does not.)
FACES_DOWN, LIES_ON_PLATE = 0.03, 0.5

#: Finest spacing of the grids that hold what is there [mm].
FINEST_MM = 0.65

#: Largest tilt of the nozzle over sheets that fill the core [deg]: they may stand close to
#: each other, and a steep nozzle keeps clear of them.
CORE_TILT_DEG = 30.0

#: Angle between a wall's normal and the vertical from which on its beads stand on each
#: other [deg], and how far the nozzle may stand off the plane through both.
WALL_DEG, OFF_PLANE_DEG = 60.0, 25.0

#: Sheets judged between two reports of progress.
AT_ONCE = 8

_CODE = {name: 1 + index for index, name in enumerate(REASON_CODES)}


@dataclass(frozen=True, eq=False)
class Assessment:
    """Outcome of the filters, with what splitting and ordering need.

    Attributes:
        report: The outcome by area.
        layers: The sheets as they were judged: those of the stack, cores turned so that
            they face up.
        sheets: One judgement per sheet of the stack.
        surroundings: Distance field of the substrate; empty without one.
        material: The part's material by sheet.
        width_mm: Width of the beads, where it was told.
    """

    report: PrintabilityReport
    layers: tuple[Layer, ...]
    sheets: tuple[SheetAssessment, ...]
    surroundings: DistanceField
    material: Material
    width_mm: float | None = None


def stage_height(stack: LayerStack) -> float:
    """Choose the finest grid spacing that matches the layers' thickness [mm]."""
    return float(min(FINEST_MM, stack.thickness_mm))


def printed_before(stack: LayerStack, sheet: int) -> Bools:
    """Mark the sheets that are printed before the outer side of a sheet.

    Envelopes grow from the inside out and planar layers from the bottom up.
    """
    index = np.arange(len(stack.sheets))
    if stack.sheets[sheet].kind == "planar":
        return index < sheet
    return index > sheet


def with_upright_cores(stack: LayerStack) -> LayerStack:
    """Turn the pieces of core sheets that face down over: a core has no outer side."""
    cores = []
    for core in stack.cores:
        piece, count = connected_pieces(len(core.vertices), core.faces)
        down = np.bincount(piece, core.face_normals[:, 2] * core.face_areas, count) < 0
        faces = core.faces.copy()
        faces[down[piece]] = faces[down[piece], ::-1]
        cores.append(replace(core, faces=faces))
    return replace(stack, cores=tuple(cores))


def assess_printability(
    stack: LayerStack,
    cell: Workcell,
    settings: PrintabilitySettings,
    report: Report,
    width_mm: float | None = None,
) -> Assessment:
    """Judge every layer: can it be printed, from which side, with which tool axes.

    Args:
        stack: The layers.
        cell: Robot, tool, placement and substrate.
        settings: Orientation policy and limits.
        report: Receives progress; may raise `Cancelled`.
        width_mm: Width of the beads; `WIDTH_RATIO` layer thicknesses when absent.

    Returns:
        The judgement of each sheet and the report over all.

    Source:
        VEGA paper, section II, F_p = f1 and f2; the solid check f2s is added here.
    """
    stack = with_upright_cores(stack)
    sheets = stack.sheets
    tool = ToolShape.of(cell.tool)
    bulk = ToolShape.of(cell.tool, OWN_LAYER_MM)
    # the normals of all sheets, too, are needed next
    makers: list[Callable[[], Any]] = [
        partial(Material, stack.part, sheets, stage_height(stack)),
        *(partial(getattr, sheet, "vertex_normals") for sheet in sheets),
    ]
    material: Material = map_threads(lambda make: make(), makers)[0]
    surroundings = EMPTY
    if cell.substrate is not None:
        surroundings = mesh_field(cell.substrate, stage_height(stack))
    report(Progress("printability", 0.1))
    stages = [printed_before(stack, sheet) for sheet in range(len(sheets))]
    material.prepare(stages)
    # what fills the core has no outer side the nozzle would have to face
    steep = replace(
        settings, max_tilt_deg=min(settings.max_tilt_deg, CORE_TILT_DEG), max_lean_deg=90.0
    )

    def judge(sheet: int, bowl: DistanceField = EMPTY, closed: Ints | None = None) -> Side:
        layer, before = sheets[sheet], stages[sheet]
        own = before.copy()
        own[sheet] = True
        fields = [
            (surroundings, tool, "substrate"),
            (material.field_of(before), tool, "printed_part"),
            (bowl, tool, "printed_part"),
            (material.field_of(own), bulk, "own_layer"),
        ]
        if layer.kind == "core":
            return judge_side(
                layer, layer.vertex_normals, fields, cell, steep, closed, False, width_mm
            )
        return judge_side(
            layer, layer.vertex_normals, fields, cell, settings, closed, True, width_mm
        )

    outside: list[Side] = []
    if not any(_held_from_below(x, EMPTY, surroundings, cell).any() for x in sheets):
        # nothing lies on anything with its outer side: the sheets do not touch each other
        for first in range(0, len(sheets), AT_ONCE):
            outside += map_threads(judge, range(first, min(first + AT_ONCE, len(sheets))))
            report(Progress("printability", 0.2 + 0.5 * len(outside) / len(sheets)))
    # what is laid from inside: filled from the outermost layer inwards
    laid = np.zeros(material.first[-1], np.bool_)
    judged = []
    flat = cell.substrate is None and bool(stack.part.restrained.any())
    for number, layer in enumerate(sheets):
        bowl = material.field_of_faces(laid) if laid.any() else EMPTY
        held = _held_from_below(layer, bowl, surroundings, cell)
        if outside and bowl is EMPTY:
            side_out = outside[number]
        else:
            # outer layers laid from inside stand there before the outer side of this one
            side_out = judge(number, bowl, _covered(layer, held, bowl, surroundings))
        label, inner = face_labels(layer, side_out, None, held), None
        if (label == NEITHER).any() or held.any():
            fields = [(surroundings, tool, "substrate"), (bowl, tool, "printed_part")]
            unused = np.where(side_out.printable & ~held, _CODE["own_layer"], 0)
            inner = judge_side(
                layer, -layer.vertex_normals, fields, cell, settings, unused, False, width_mm
            )
            label = face_labels(layer, side_out, inner, held)
        side_out, label = with_hope(layer, side_out, label, flat)
        if inner is not None and cell.substrate is not None:
            inner, label = with_hope_inside(layer, inner, label)
        label = without_noise(layer, label)
        laid[material.first[number] : material.first[number + 1]] = label == INSIDE
        judged.append(SheetAssessment(side_out, inner, label))
        report(Progress("printability", 0.7 + 0.3 * (number + 1) / len(sheets)))

    def held_there(
        sheet: int, vertices: Ints, axes: Floats, shape: ToolShape, mm: float
    ) -> Floats:
        tips = sheets[sheet].vertices[vertices]
        gap = shape.height_above(tips, axes) - cell.placement.plate_z_mm + mm
        before = material.field_of(stages[sheet])
        for field in (surroundings, before):
            if field is not EMPTY:
                gap = np.minimum(gap, field.clearance(shape, tips, axes, mm, mm))
        return gap

    summary = summarised(stack, judged, cell, settings, held_there)
    return Assessment(summary, sheets, tuple(judged), surroundings, material, width_mm)


def _covered(layer: Layer, held: Bools, bowl: DistanceField, surroundings: DistanceField) -> Ints:
    """Reason code of the vertices on whose outer side something lies, 0 elsewhere.

    Where the next layer out is there already, no tip fits in, however it is turned.
    """
    code = np.where(held, _CODE["plate"], 0)
    outward = layer.vertices + layer.bead_thickness[:, None] * layer.vertex_normals
    for field, name in ((surroundings, "substrate"), (bowl, "printed_part")):
        if field is not EMPTY:
            code[field.distance(outward) < 0.25 * layer.bead_thickness] = _CODE[name]
    return code


def judge_side(
    layer: Layer,
    normals: Floats,
    fields: list[tuple[DistanceField, ToolShape, str]],
    cell: Workcell,
    settings: PrintabilitySettings,
    closed: Ints | None = None,
    see: bool = True,
    width_mm: float | None = None,
) -> Side:
    """Apply f1, f2 and f2s to one side of a sheet.

    Args:
        layer: The sheet.
        normals: Unit normals on the side of the nozzle, shape (n, 3).
        fields: What is there: its distance field, the tool to hold against it, and the
            reason code where it is hit.
        cell: Robot, tool and placement.
        settings: Policy and limits.
        closed: Reason code of vertices that something touches on this side, 0 elsewhere,
            shape (n,); no tool is tried there.
        see: Whether to apply f2 against the layer itself.
        width_mm: Width of the beads; `WIDTH_RATIO` layer thicknesses when absent.
    """
    points = layer.vertices
    shape = fields[0][1]
    if closed is None:
        closed = np.zeros(len(points), np.int64)
    wanted = settings.clearance_mm

    def clearance(index: Ints, tips: Floats, axes: Floats) -> Floats:
        gap = np.where(closed[index] > 0, -np.inf, np.inf)
        todo = np.flatnonzero(gap > 0)
        for field, tool, _ in fields:
            if field is not EMPTY and len(todo):
                gap[todo] = field.clearance(tool, tips[todo], axes[todo], wanted, wanted)
                todo = todo[gap[todo] >= wanted]
        return gap

    limit = plate_tilt_limit(points, normals, layer.bead_thickness, shape, cell, wanted, width_mm)
    limit[closed > 0] = -1.0
    oriented = orient(points, layer.faces, normals, limit, clearance, settings)
    axes = oriented.axes
    code = np.zeros(len(points), np.int64)
    reach = cell.robot.reach_reason(*cell.to_base(points, axes))
    reachable = reach == 0
    seen = np.ones(len(points), np.bool_)
    if see:
        # half the bead is the layer itself: the line counts from its surface on
        offset = 0.5 * float(np.median(layer.bead_thickness))
        seen = ~Occluder(layer).blocks(points, axes, offset)
    if not oriented.clear.all():
        missed = np.flatnonzero(~oriented.clear)
        code[missed] = _CODE["plate"]
        for field, tool, name in fields:
            gap = field.clearance(tool, points[missed], axes[missed], wanted, wanted)
            code[missed[gap < wanted]] = _CODE[name]
        code[closed > 0] = closed[closed > 0]
    code[~seen] = _CODE["own_layer"]
    lean = np.einsum("ij,ij->i", axes, normals) < np.cos(np.radians(settings.max_lean_deg)) - 1e-9
    steep = tilt_of(normals) > np.radians(90 + settings.max_overhang_deg) + 1e-9
    if settings.orientation == "vertical":
        lean &= steep
    hopeful = (code == 0) & lean
    if hopeful.any():
        off = np.arccos(np.clip(np.einsum("ij,ij->i", axes, normals), -1, 1))
        off += tilt_of(axes) - tilt_of(normals)
        hopeful &= (tilt_of(normals) > np.radians(WALL_DEG)) & (off < np.radians(OFF_PLANE_DEG))
    if settings.orientation == "collision-free":
        later = np.isin(code, [_CODE[name] for name in ("own_layer", "printed_part", "plate")])
        hopeful |= later & (limit >= 0)
        stuck = hopeful & ~oriented.clear
        axes = np.where(stuck[:, None], [0.0, 0.0, 1.0], axes)
    hopeful &= ~steep & reachable & (closed == 0)
    code[(code == 0) & (lean | steep)] = _CODE["no_support"]
    code[reach == 2] = _CODE["wrist_limit"]
    code[reach == 1] = _CODE["out_of_travel"]
    return Side(axes, code, reachable, seen, oriented.clear, hopeful)


def plate_tilt_limit(
    points: Floats,
    normals: Floats,
    thickness: Floats,
    tool: ToolShape,
    cell: Workcell,
    clearance_mm: float,
    width_mm: float | None = None,
) -> Floats:
    """Find the largest tilt the plate leaves at points of a sheet [rad].

    Beads are set in from a rim by half their width w, so a rim that lies on the plate is
    judged where its first bead will be: at the height w/2 sin(slope), and no lower than
    half a layer. The tip itself may come as near as a quarter of the layer.

    Args:
        points: Points on the middle surface [mm], shape (n, 3).
        normals: Unit normals there, shape (n, 3).
        thickness: Local layer thickness [mm], shape (n,).
        tool: The tool.
        cell: Placement of the part over the plate.
        clearance_mm: Distance the tool keeps.
        width_mm: Width w of the beads; the paper's proportion 1.5 t when absent. Wide flat
            beads are counted without what their round sides lack.

    Returns:
        Largest tilts [rad], shape (n,); negative where even the upright tool is too low.
    """
    slope = np.hypot(normals[:, 0], normals[:, 1])
    strip = WIDTH_RATIO * thickness
    if width_mm is not None:
        strip = np.maximum(strip, width_mm - 0.25 * thickness)
    first_bead = np.maximum(0.5 * thickness, 0.5 * strip * slope)
    height = np.maximum(points[:, 2] - cell.placement.plate_z_mm, first_bead)
    least = float(thickness.min()) if len(thickness) else clearance_mm
    return tool.largest_tilt(height, min(clearance_mm, 0.25 * least))


def _held_from_below(
    layer: Layer, bowl: DistanceField, surroundings: DistanceField, cell: Workcell
) -> Bools:
    """Mark the vertices that face down onto the plate, the substrate or a layer laid there."""
    held = layer.vertex_normals[:, 2] < -FACES_DOWN
    index = np.flatnonzero(held)
    thickness = layer.bead_thickness[index]
    under = layer.vertices[index] + thickness[:, None] * layer.vertex_normals[index]
    held[index] = (
        (
            (under[:, 2] <= cell.placement.plate_z_mm)
            & (layer.vertex_normals[index, 2] < -LIES_ON_PLATE)
        )
        | (surroundings.distance(under) < 0.25 * thickness)
        | (bowl.distance(under) < 0.25 * thickness)
    )
    return held
