# SPDX-License-Identifier: Apache-2.0
"""Put the patches into print order and prove that the nozzle is clear at every stage."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from vega_planner.datatypes import (
    REASON_CODES,
    Bools,
    Floats,
    Layer,
    LayerStack,
    Patch,
    PrintabilityReport,
    Reason,
)
from vega_planner.ordering.graph import break_cycles, sequence
from vega_planner.ordering.proof import FLOATING_SHARE, Proven, bad_area, proven_order
from vega_planner.ordering.task import BLOCK_SHARE, SUPPORT_SHARE, Graph, OrderTask
from vega_planner.ordering.untangle import FINEST_WIDTHS, in_bands, untangled
from vega_planner.printability.assessment import (
    Assessment,
    stage_height,
)
from vega_planner.printability.material import EMPTY, mesh_field
from vega_planner.printability.tool_shape import ToolShape
from vega_planner.progress import Progress, Report
from vega_planner.settings import PrintabilitySettings

if TYPE_CHECKING:
    from vega_planner.robot.workcell import Workcell

#: Share of the area that may collide or float in the natural order before another one is
#: looked for.
ACCEPTED_SHARE = 2e-3

#: Share of the area that may collide or float before patches that wait for each other are
#: cut as finely as can be.
TOO_MUCH = 0.03


@dataclass(frozen=True)
class Violation:
    """Something the sequence does not keep.

    Attributes:
        kind: "order" (a patch before one it needs), "collision" or "no_support".
        patches: Positions in the print order of the patches concerned.
        amount: Share of the patch for "order"; area [mm²] else.
    """

    kind: str
    patches: tuple[int, ...]
    amount: float


@dataclass(frozen=True, eq=False)
class PrintOrder:
    """Patches in print order, with the proof.

    Attributes:
        patches: In print order; the axes of some may have been raised to keep clear.
        supports: supports[a, b]: share of b that lies on a, by position, shape (n, n).
        blocks: blocks[a, b]: share of a's poses that would meet b, shape (n, n).
        colliding_mm2: Area of each patch where the tool is not clear of what is there.
        floating_mm2: Area of each patch with nothing under it when it is printed.
        report: The assessment's report, with what the sequence adds.
    """

    patches: tuple[Patch, ...]
    supports: Floats
    blocks: Floats
    colliding_mm2: Floats
    floating_mm2: Floats
    report: PrintabilityReport

    def violations(self) -> tuple[Violation, ...]:
        """List what the sequence does not keep; empty for a sound one."""
        found = []
        lies_on = (self.supports > SUPPORT_SHARE) & (self.supports >= self.supports.T)
        for a, b in zip(*np.nonzero(lies_on)):
            if a > b:
                found.append(Violation("order", (int(a), int(b)), float(self.supports[a, b])))
        for a, b in zip(*np.nonzero(self.blocks > BLOCK_SHARE)):
            if a > b:
                found.append(Violation("order", (int(a), int(b)), float(self.blocks[a, b])))
        for kind, areas in (
            ("collision", self.colliding_mm2),
            ("no_support", self.floating_mm2),
        ):
            for a in np.flatnonzero(areas > 0):
                found.append(Violation(kind, (int(a),), float(areas[a])))
        return tuple(found)


def order_patches(
    patches: Sequence[Patch],
    stack: LayerStack,
    cell: Workcell,
    settings: PrintabilitySettings,
    report: Report,
    assessment: Assessment | None = None,
    cut: bool = False,
) -> PrintOrder:
    """Find the deposition sequence.

    What lies under a bead comes first, what would stand in the nozzle's way later; among
    what is free, the paper's rule decides: bottom to top, and at one level inside to
    outside. Patches that wait for each other get steeper tool axes; where that does not
    help, the weakest obstacle gives way and shows in `violations`.

    Args:
        patches: Pieces of the layers with their tool axes.
        stack: The layers.
        cell: Robot, tool, placement and substrate.
        settings: Limits and clearance.
        report: Receives progress; may raise `Cancelled`.
        assessment: The judgement the patches come from; its report is carried on.
        cut: Whether to cut patches that wait for each other into bands of height, at the
            price of rims between the bands. Whole patches whose nozzle is not clear are
            resolved pass by pass when the paths are laid.

    Returns:
        The patches in print order with the proof.
    """
    patches = list(patches)
    tool = ToolShape.of(cell.tool)
    if assessment is not None:
        surroundings = assessment.surroundings
    elif cell.substrate is not None:
        surroundings = mesh_field(cell.substrate, stage_height(stack))
    else:
        surroundings = EMPTY
    if not patches:
        empty = np.zeros((0, 0))
        base = _base_report(assessment)
        return PrintOrder((), empty, empty, np.zeros(0), np.zeros(0), base)
    task = OrderTask(stack, cell, settings, surroundings, tool, assessment)
    graph = task.graph(patches)
    report(Progress("ordering", 0.2))
    found, natural = None, None
    if assessment is not None and not cut:
        natural = graph, _with_cores_held(_natural_order(patches, assessment), graph, assessment)
        found = proven_order(task, *natural, report, ACCEPTED_SHARE * _area(graph))
    if found is None:
        graph = task.with_blocking(graph)
        uncut = graph
        if settings.orientation == "collision-free" and graph.tangles():
            graph = untangled(task, graph, report, cut)
        other = None
        if len(graph.patches) > len(uncut.patches):
            other = _proven_graph(task, graph, report, TOO_MUCH * _area(graph))
            if other is None:
                graph = in_bands(task, uncut, FINEST_WIDTHS) or graph
        other = other or _proven_graph(task, graph, report)
        assert other is not None
        if found is None and natural is not None:
            found = proven_order(task, *natural, report, other.cost)
        if found is None or other.cost < found.cost:
            found = other
    base = _base_report(assessment)
    if len(found.patches) > len(patches) and base.status == "fully":
        base = replace(base, status="conditionally")
    return PrintOrder(
        found.patches,
        found.supports,
        found.blocks,
        found.colliding,
        found.floating,
        _with_sequence(base, found.patches, found.bad, found.floating),
    )


def _area(graph: Graph) -> float:
    """Area of all patches [mm²]."""
    return sum(patch.area for patch in graph.patches)


def _proven_graph(
    task: OrderTask, graph: Graph, report: Report, most_mm2: float = np.inf
) -> Proven | None:
    """Order patches by what they wait for and the paper's rule, and prove it."""
    before, _ = break_cycles(graph.hard, graph.soft)
    order = sequence(before, _keys(graph.patches, task.stack))
    return proven_order(task, graph, order, report, most_mm2)


def _natural_order(patches: Sequence[Patch], assessment: Assessment) -> list[int]:
    """What the assessment has proven: bowls from the outermost in, then from the inside out.

    Planar sheets come from the bottom up; within a sheet the lowest piece comes first.
    """
    keys = []
    for node, patch in enumerate(patches):
        sheet = assessment.layers[patch.layer]
        low = round(float(patch.vertices[:, 2].min()), 6)
        bowl = _is_turned(patch, sheet)
        up = bowl or sheet.kind == "planar"
        keys.append((not bowl, patch.layer if up else -patch.layer, low, node))
    return [key[-1] for key in sorted(keys)]


def _with_cores_held(order: list[int], graph: Graph, assessment: Assessment) -> list[int]:
    """Move the pieces of the core behind what they lie on, and before what lies on them."""
    core = np.array([assessment.layers[p.layer].kind == "core" for p in graph.patches])
    if not core.any():
        return order
    chain = np.zeros((len(order), len(order)), np.bool_)
    firm = [node for node in order if not core[node]]
    chain[firm[:-1], firm[1:]] = True
    share = np.where(graph.hard, graph.support.share, 0.0)
    share[~(core[:, None] | core[None, :])] = 0.0
    before, _ = break_cycles(chain, share)
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    return sequence(before, [(int(k),) for k in rank])


def _is_turned(patch: Patch, sheet: Layer) -> bool:
    """Tell whether a patch is printed from the inner side of its sheet."""
    face = int(np.argmax(patch.face_areas))
    middle = patch.vertices[patch.faces[face]].mean(0)
    away = sheet.vertices[sheet.faces].mean(1) - middle
    nearest = int(np.argmin((away**2).sum(1)))
    return bool(patch.face_normals[face] @ sheet.face_normals[nearest] < 0)


def _keys(patches: Sequence[Patch], stack: LayerStack) -> list[tuple]:
    """Priorities of the paper's rule: bottom to top, then inside to outside."""
    keys = []
    for patch in patches:
        level = round(float(patch.vertices[:, 2].min()) / (2 * stack.thickness_mm))
        sheet = stack.sheets[patch.layer]
        inside_first = patch.layer if sheet.kind == "planar" else -patch.layer
        keys.append((level, inside_first))
    return keys


def _base_report(assessment: Assessment | None) -> PrintabilityReport:
    if assessment is not None:
        return assessment.report
    return PrintabilityReport("fully", 1.0, 1.0, 1.0)


def with_interleaved(
    order: PrintOrder, floating_mm2: Floats, assessment: Assessment
) -> PrintOrder:
    """Tell what an order is once the passes of its patches are interleaved.

    Args:
        order: The order of the patches, each printed whole.
        floating_mm2: Area of each patch with nothing under it when it is printed now.
        assessment: The judgement the patches come from.

    Returns:
        The order; whether the nozzle is clear is left to the check of every waypoint.
    """
    count = len(order.patches)
    told = np.where(
        floating_mm2 > FLOATING_SHARE * np.array([patch.area for patch in order.patches]),
        floating_mm2,
        0.0,
    )
    none = [np.zeros(len(patch.vertices), np.bool_) for patch in order.patches]
    report = _with_sequence(assessment.report, order.patches, none, told)
    if report.status == "fully":
        report = replace(report, status="conditionally")
    return replace(order, colliding_mm2=np.zeros(count), floating_mm2=told, report=report)


def _with_sequence(
    base: PrintabilityReport, patches: Sequence[Patch], bad: Sequence[Bools], floating: Floats
) -> PrintabilityReport:
    """Add to a report what only the sequence shows."""
    total = sum(patch.area for patch in patches)
    reasons = list(base.reasons)
    lost = 0.0
    for patch, hit in zip(patches, bad):
        area = bad_area(patch, hit)
        if area > 1.0:
            lost += area
            middle = patch.vertices[hit].mean(0)
            remedy = "split the layer lower, or choose another restraint region (--brr)"
            where = (float(middle[0]), float(middle[1]), float(middle[2]))
            reasons.append(Reason("printed_part", patch.layer, area, where, remedy))
    for patch, area in zip(patches, floating):
        if area > 1.0:
            middle = patch.vertices.mean(0)
            where = (float(middle[0]), float(middle[1]), float(middle[2]))
            remedy = "a substrate under it (vega substrate), or a base to grow from (--brr)"
            reasons.append(Reason("no_support", patch.layer, float(area), where, remedy))
    reasons.sort(key=lambda reason: (-reason.area_mm2, reason.layer, reason.code))
    assert all(reason.code in REASON_CODES for reason in reasons)
    return replace(
        base,
        collision_free_ratio=min(base.collision_free_ratio, 1 - lost / max(total, 1e-300)),
        reasons=tuple(reasons),
    )
