# SPDX-License-Identifier: Apache-2.0
"""From ordered patches to passes and the moves between them."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from vega_planner.datatypes import (
    Floats,
    LayerStack,
    Patch,
    Toolpath,
    ToolpathSet,
    Travel,
    row_lengths,
)
from vega_planner.parallel import map_threads
from vega_planner.progress import Progress, Report, silent
from vega_planner.settings import ToolpathSettings
from vega_planner.toolpaths.bead import (
    fill_spacing,
    fill_width,
    lean,
    leaning_section,
    section_area,
)
from vega_planner.toolpaths.carrier import Carrier
from vega_planner.toolpaths.contour import contour_lines
from vega_planner.toolpaths.isolines import (
    AXIS,
    CELL,
    NORMAL,
    POSITION,
    THICKNESS,
    Line,
    vertex_values,
)
from vega_planner.toolpaths.linking import Pass, attach_lines, link_lines, link_loops
from vega_planner.toolpaths.planar import concentric_lines, is_flat, parallel_lines
from vega_planner.toolpaths.polyline_kernels import line_length, resample
from vega_planner.toolpaths.rim import Ground, ground_of
from vega_planner.toolpaths.sequence import shortest_sequence
from vega_planner.toolpaths.smoothing_kernels import smooth_axes, without_crowding
from vega_planner.toolpaths.spiral import spiral_passes
from vega_planner.toolpaths.surface import connect
from vega_planner.toolpaths.travel import TravelPlanner
from vega_planner.toolpaths.turns import bend_ends
from vega_planner.toolpaths.wedges import corner_lines, wedge_lines
from vega_planner.toolpaths.zigzag import Zigzag, zigzag_lines

if TYPE_CHECKING:
    from vega_planner.robot.workcell import Workcell

#: Points of a pass: how far the path may leave the surface between them, how far apart
#: they are at most, and how far the axis turns from one to the next at most.
CHORD_MM, STEP_MM, TURN_DEG = 0.008, 1.0, 3.0

#: Points of a line that are nearer than this are one; the nozzle's direction is averaged
#: along the pass with this standard deviation.
CROWDED_MM, CALM_MM = 0.03, 1.0

#: Shorter passes are left out: nothing flows in the time they take.
SHORTEST_MM = 0.3

#: A line in a wedge that no pass ends near is laid if it is this long, in spacings.
_ALONE = 0.9

#: The seam, where loops start, moves on by this from one patch to the next but one, so
#: that seams do not pile up and the way to the next start stays short.
_SEAM_TURN_DEG = 25.0

#: A pass that rises by more than this from one end to the other is printed upwards [mm].
_CLIMB_MM = 1.5

#: The flow of a patch is changed by at most this part to get its volume right.
_MOST_BALANCE = 0.03

#: The layers below the outermost one give at most this much of their flow to it.
_LEAST_INNER_FLOW = 0.95


def lay_toolpaths(
    patches: tuple[Patch, ...],
    stack: LayerStack,
    cell: Workcell,
    settings: ToolpathSettings,
    report: Report = silent,
) -> ToolpathSet:
    """Lay passes on every patch and the moves between them.

    Args:
        patches: What is printed, in print order.
        stack: The layers they were cut from.
        cell: Plate and tool; the moves keep clear of what is printed.
        settings: Pattern, spacing and linking.
        report: Told how far it is; may raise `Cancelled`.

    Returns:
        Passes in print order with the moves between them.
    """
    flat = stack.engine == "planar"
    ground = ground_of(_plate(cell), cell.substrate)
    skin = skin_overlap(patches, stack, settings.skin_overlap_ratio)
    work = list(enumerate(patches))
    passes: list[tuple[list[Pass], bool]] = []
    chunk = 8
    for start in range(0, len(work), chunk):
        report(Progress("toolpaths", 0.8 * start / max(len(work), 1), detail="passes"))
        passes += map_threads(
            lambda item: patch_passes(
                item[1], item[0], flat, settings, ground, *skin.of(item[1].layer)
            ),
            work[start : start + chunk],
        )
    report(Progress("toolpaths", 0.8, detail="travel"))
    paths = _in_order([found for found, _ in passes], patches, settings)
    moves, warnings = plan_moves(paths, cell, report)
    loops = sum(not nested for _, nested in passes)
    if loops:
        warnings += (f"{loops} patches are no single nest of loops: loops instead of a spiral",)
    return ToolpathSet(tuple(paths), tuple(moves), warnings)


def _plate(cell: Workcell) -> float:
    return float(cell.placement.plate_z_mm)


@dataclass(frozen=True)
class Skin:
    """Overlap of the outermost layer's lines, and the flow below it that pays for it.

    Attributes:
        layer: Index of the outermost layer; -1 where no layer is treated apart.
        overlap: Part of the spacing by which its lines lie closer.
        flow: Factor on the flow of all other layers.
    """

    layer: int
    overlap: float
    flow: float

    def of(self, layer: int) -> tuple[float, float]:
        """Overlap and flow of a layer."""
        if layer == self.layer:
            return self.overlap, 1 / (1 - self.overlap)
        return 0.0, self.flow


def skin_overlap(patches: tuple[Patch, ...], stack: LayerStack, overlap: float) -> Skin:
    """Find how the other layers pay for the overlap of the outermost one.

    The groove between two beads is as deep as their sides are round. On the surface
    that is seen, lines lie closer; the volume that this adds is taken off the layers
    below, so that the part's volume stays right.

    Args:
        patches: What is printed.
        stack: The layers; planar ones have no outermost one.
        overlap: Wanted overlap.
    """
    if stack.engine == "planar" or not stack.layers:
        return Skin(-1, 0.0, 1.0)
    whole = sum(float(patch.area * np.median(patch.thickness)) for patch in patches)
    outer = sum(
        float(patch.area * np.median(patch.thickness)) for patch in patches if patch.layer == 0
    )
    if whole - outer <= 0 or outer <= 0:
        return Skin(-1, 0.0, 1.0)
    added = min(outer * overlap / (1 - overlap), (1 - _LEAST_INNER_FLOW) * (whole - outer))
    return Skin(0, added / (outer + added), 1 - added / (whole - outer))


def patch_passes(
    patch: Patch,
    index: int,
    flat: bool,
    settings: ToolpathSettings,
    ground: Ground,
    overlap: float = 0.0,
    flow: float = 1.0,
) -> tuple[list[Pass], bool]:
    """Lay the passes of one patch.

    Args:
        patch: The patch.
        index: Its place in the print order, which turns zigzag lines and the seam.
        flat: Whether it belongs to a planar stack, with walls inside the outline.
        settings: Pattern, spacing and linking.
        ground: What a rim may stand on.
        overlap: Part of the spacing by which lines lie closer.
        flow: Factor on the width of the strips they fill.

    Returns:
        Passes, thinned out to the points the path needs, and False where a spiral was
        wanted but the loops are not nested, so that they stay loops.
    """
    thickness = float(np.median(patch.thickness))
    spacing = (1 - overlap) * fill_spacing(settings.width_mm, thickness)
    longest = settings.link_ratio * settings.width_mm
    seam = math.radians(_SEAM_TURN_DEG * (index // 2))
    toward = np.array([math.cos(seam), math.sin(seam), 0.0])
    surface = connect(patch)
    nested = True
    euclidean = settings.spacing == "euclidean"
    if settings.pattern != "zigzag" and (flat or is_flat(patch)):
        lines = concentric_lines(surface, patch, spacing, inside=flat)
        lines = [_scaled(line, flow) for line in lines]
        found = link_loops(lines, spacing, longest, toward)
    elif settings.pattern == "zigzag":
        angle = settings.angle_deg + 90.0 * (patch.layer % 2)
        if flat or is_flat(patch):
            loops, lines, guides = parallel_lines(surface, patch, spacing, angle, inside=flat)
            nowhere = np.zeros(len(patch.vertices))
            laid = Zigzag(loops, lines, guides, vertex_values(patch, spacing, nowhere))
        else:
            laid = zigzag_lines(surface, patch, spacing, angle, ground=ground, euclidean=euclidean)
        lines = [_scaled(line, flow) for line in laid.lines]
        found = link_lines(laid.loops, lines, laid.guides, spacing, longest, toward)
        if laid.lines and not (flat or euclidean):
            carrier = Carrier(patch.vertices, laid.values)
            wedges = wedge_lines(laid.loops, found, carrier, spacing)
            wedges = [_scaled(line, flow) for line in wedges]
            found = attach_lines(found, wedges, longest, _ALONE * spacing)
            found = bend_ends(found, [*lines, *wedges], carrier, spacing)
            corners = corner_lines(surface, laid.values, found, spacing)
            if corners:
                corners = [_scaled(line, flow) for line in corners]
                found = attach_lines(found, corners, longest, _ALONE * spacing)
                found = bend_ends(found, corners, carrier, spacing)
    else:
        lines, used = contour_lines(surface, patch, spacing, ground=ground, euclidean=euclidean)
        lines = [_scaled(line, flow) for line in lines]
        turns = None
        if settings.pattern == "spiral":
            turns = spiral_passes(lines, used, longest, toward)
            nested = turns is not None
        found = turns or link_loops(lines, used, longest, toward)
    cosine = math.cos(math.radians(TURN_DEG))
    thinned = [
        Pass(resample(_calm(item), CHORD_MM, STEP_MM, cosine), item.closed)
        for item in found
        if len(item.rows) >= 2 and line_length(item.rows, False) >= SHORTEST_MM
    ]
    return (thinned if euclidean else _balanced(thinned, patch, flow, settings)), nested


def _balanced(
    passes: list[Pass], patch: Patch, flow: float, settings: ToolpathSettings
) -> list[Pass]:
    """Scale the flow of a patch a little, so that its passes deposit its volume.

    What cannot be filled where it is missing (the wedge between a rim and the plate, a
    sharp corner) is pressed there by what lies around it.
    """
    wanted = flow * float(patch.face_areas @ patch.thickness[patch.faces].mean(1))
    laid = 0.0
    for item in passes:
        area = section_area(_width(item.rows, settings), item.rows[:, THICKNESS])
        step = row_lengths(np.diff(item.rows[:, POSITION], axis=0))
        laid += float((0.5 * (area[1:] + area[:-1]) * step).sum())
    factor = float(np.clip(wanted / max(laid, 1e-9), 1 - _MOST_BALANCE, 1 + _MOST_BALANCE))
    balanced = []
    for item in passes:
        rows = item.rows.copy()
        rows[:, CELL] *= factor
        balanced.append(Pass(rows, item.closed))
    return balanced


def _scaled(line: Line, flow: float) -> Line:
    """Change the flow of a line, unless it is the one at the rim, which has its place."""
    if line.level == 0 and flow > 1:
        return line
    rows = line.rows.copy()
    rows[:, CELL] *= flow
    return replace(line, rows=rows)


def _calm(item: Pass) -> Floats:
    rows = without_crowding(item.rows, CROWDED_MM)
    return smooth_axes(rows, AXIS.start, CALM_MM, item.closed)


def _in_order(
    found: list[list[Pass]], patches: tuple[Patch, ...], settings: ToolpathSettings
) -> list[Toolpath]:
    """Put the passes of each patch in order, from where the one before ended."""
    paths: list[Toolpath] = []
    at: Floats | None = None
    for index, group in enumerate(found):
        for n, backwards in shortest_sequence(group, at):
            item = group[n]
            rise = float(item.rows[-1, POSITION][2] - item.rows[0, POSITION][2])
            if abs(rise) > _CLIMB_MM:
                # the nozzle stands steep beside a wall: upwards, it stays above what is there
                backwards = rise < 0
            rows = item.rows[::-1] if backwards else item.rows
            paths.append(_toolpath(rows, item.closed, index, patches[index].layer, settings))
            at = rows[-1, POSITION]
    return paths


def _toolpath(
    rows: Floats, closed: bool, patch: int, layer: int, settings: ToolpathSettings
) -> Toolpath:
    height = rows[:, THICKNESS]
    width = _width(rows, settings)
    leaning = lean(rows[:, POSITION], rows[:, AXIS], rows[:, NORMAL])
    width, height = leaning_section(width, height, leaning)
    return Toolpath(
        rows[:, POSITION], rows[:, AXIS], width, height, patch=patch, layer=layer, closed=closed
    )


def _width(rows: Floats, settings: ToolpathSettings) -> Floats:
    height = rows[:, THICKNESS]
    nominal = fill_spacing(settings.width_mm, float(np.median(height)))
    return fill_width(rows[:, CELL], height, nominal)


def plan_moves(
    paths: list[Toolpath], cell: Workcell, report: Report
) -> tuple[list[Travel], tuple[str, ...]]:
    """Find the moves between passes, before the first and after the last.

    Args:
        paths: Passes in print order.
        cell: Plate and tool.
        report: Told how far it is; may raise `Cancelled`.

    Returns:
        One move more than there are passes, and warnings.
    """
    if not paths:
        return [], ()
    low = np.min([path.points.min(0) for path in paths], axis=0)
    high = np.max([path.points.max(0) for path in paths], axis=0)
    substrate = cell.substrate
    if substrate is not None:
        low = np.minimum(low, substrate.vertices.min(0))
        high = np.maximum(high, substrate.vertices.max(0))
    planner = TravelPlanner(low, high, _plate(cell), cell.tool)
    if substrate is not None:
        points = np.concatenate([substrate.vertices, substrate.vertices[substrate.faces].mean(1)])
        planner.add_points(points, np.zeros(len(points)), 1.0)
    moves = [planner.arrive(paths[0])]
    for n, (before, after) in enumerate(itertools.pairwise(paths)):
        if n % 16 == 0:
            report(Progress("toolpaths", 0.8 + 0.2 * n / len(paths), detail="travel"))
        planner.add(before)
        moves.append(planner.move(before, after))
    planner.add(paths[-1])
    moves.append(planner.leave(paths[-1]))
    warnings: tuple[str, ...] = ()
    if planner.blocked:
        warnings = (
            f"{planner.blocked} travel moves found no clear hop and draw the tool back along "
            "its axis until it is above the part",
        )
    return moves, warnings
