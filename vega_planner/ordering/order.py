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
    Ints,
    Layer,
    LayerStack,
    Patch,
    PrintabilityReport,
    Reason,
)
from vega_planner.ordering.dependencies import Support, find_blocking, find_support
from vega_planner.ordering.graph import break_cycles, cycles, sequence
from vega_planner.ordering.samples import Samples, sample_patches
from vega_planner.parallel import map_threads
from vega_planner.printability.assessment import (
    OWN_LAYER_MM,
    Assessment,
    plate_tilt_limit,
    printed_before,
    stage_height,
)
from vega_planner.printability.material import EMPTY, DistanceField, Material, mesh_field
from vega_planner.printability.orientation import raise_until_clear, smoothed, tilt_of, tilted
from vega_planner.printability.tool_shape import ToolShape
from vega_planner.progress import Progress, Report
from vega_planner.settings import PrintabilitySettings
from vega_planner.splitting.bands import bands

if TYPE_CHECKING:
    from vega_planner.robot.workcell import Workcell

#: Share of a patch that must lie on another for it to wait for that one.
SUPPORT_SHARE = 0.1

#: Share of a patch's poses that meet another for the other to wait. Poses fewer than this
#: are turned out of the way, one by one, when the sequence is checked.
BLOCK_SHARE = 0.02


#: Share of the area that may collide or float in the natural order before another one is
#: looked for.
ACCEPTED_SHARE = 2e-3

#: Share of a patch without anything under it that is told.
FLOATING_SHARE = 0.05

#: Largest tilts tried for patches that wait for each other [deg].
TILTS_DEG = (45.0, 20.0)

#: Heights of the bands they are cut into where that does not help [mm].
BANDS_MM = (6.0, 3.0, 1.5)

#: Number of patches at which cutting ends.
MOST_PATCHES = 400


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
        cut: Whether to cut patches that wait for each other into bands of height even where
            all layers are printable as they are.

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
    task = _Task(stack, cell, settings, surroundings, tool, assessment)
    graph = task.graph(patches)
    report(Progress("ordering", 0.2))
    found = None
    if assessment is not None:
        order = _with_cores_held(_natural_order(patches, assessment), graph, assessment)
        found = _proven(task, graph, order, report)
    if cut or found is None or found.cost > ACCEPTED_SHARE * sum(p.area for p in patches):
        graph = task.with_blocking(graph)
        if settings.orientation == "collision-free" and graph.tangles():
            # layers that are printable as they are stay whole: what is left is resolved
            # pass by pass when the paths are laid
            cut = cut or _base_report(assessment).status != "fully"
            graph = _untangled(task, graph, report, cut)
        before, _ = break_cycles(graph.hard, graph.soft)
        other = _proven(task, graph, sequence(before, _keys(graph.patches, stack)), report)
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
        _with_sequence(base, found),
    )


def _are_sheets(patches: Sequence[Patch], sheets: Sequence[Layer]) -> bool:
    """Tell whether the patches are the sheets, whole and in their order."""
    return len(patches) == len(sheets) and all(
        patch.layer == number
        and np.array_equal(patch.faces, sheet.faces)
        and np.array_equal(patch.vertices, sheet.vertices)
        for number, (patch, sheet) in enumerate(zip(patches, sheets))
    )


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


def _with_cores_held(order: list[int], graph: _Graph, assessment: Assessment) -> list[int]:
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
    nearest = int(np.argmin(((sheet.vertices - middle) ** 2).sum(1)))
    return bool(patch.face_normals[face] @ sheet.vertex_normals[nearest] < 0)


def _keys(patches: Sequence[Patch], stack: LayerStack) -> list[tuple]:
    """Priorities of the paper's rule: bottom to top, then inside to outside."""
    keys = []
    for patch in patches:
        level = round(float(patch.vertices[:, 2].min()) / (2 * stack.thickness_mm))
        sheet = stack.sheets[patch.layer]
        inside_first = patch.layer if sheet.kind == "planar" else -patch.layer
        keys.append((level, inside_first))
    return keys


@dataclass(frozen=True, eq=False)
class _Graph:
    """Patches with what they lie on and what stands in their way."""

    patches: tuple[Patch, ...]
    material: Material
    samples: Samples
    support: Support
    blocked: Floats

    @property
    def hard(self) -> Bools:
        """Edges of support: of two that lie on each other, the one that carries more."""
        share = self.support.share
        hard = share > SUPPORT_SHARE
        return hard & ~(hard.T & (share < share.T))

    @property
    def soft(self) -> Floats:
        """Weights of the edges of blocking."""
        return np.where(self.blocked > BLOCK_SHARE, self.blocked, 0.0)

    def tangles(self) -> list[list[int]]:
        """Groups of patches that wait for each other."""
        return cycles(self.hard | (self.soft > 0))


@dataclass(frozen=True, eq=False)
class _Task:
    """What stays the same while orders are tried."""

    stack: LayerStack
    cell: Workcell
    settings: PrintabilitySettings
    surroundings: DistanceField
    tool: ToolShape
    assessment: Assessment | None

    def graph(self, patches: Sequence[Patch]) -> _Graph:
        """Find what the patches lie on; blocking is left open."""
        count = len(patches)
        if self.assessment is not None and _are_sheets(patches, self.assessment.layers):
            material = self.assessment.material
        else:
            material = Material(self.stack.part, patches, stage_height(self.stack))
        owner = np.repeat(np.arange(count), np.diff(material.first))
        samples = sample_patches(patches)
        plate = self.cell.placement.plate_z_mm
        support = find_support(samples, count, material, owner, self.surroundings, plate)
        return _Graph(tuple(patches), material, samples, support, np.zeros((count, count)))

    def with_blocking(self, graph: _Graph, patches: Sequence[Patch] | None = None) -> _Graph:
        """Find what stands in the nozzle's way, with other axes where patches are given."""
        patches = graph.patches if patches is None else tuple(patches)
        samples = sample_patches(patches)
        blocked = find_blocking(
            samples, samples, len(patches), self.tool, self.settings.clearance_mm
        )
        return replace(graph, patches=patches, samples=samples, blocked=blocked)


def _untangled(task: _Task, graph: _Graph, report: Report, cut: bool) -> _Graph:
    """Resolve cycles: first by steeper tool axes, then by cutting into bands of height."""
    for most_deg in TILTS_DEG:
        patches = list(graph.patches)
        for nodes in graph.tangles():
            for node in nodes:
                patches[node] = _raised(patches[node], np.radians(most_deg))
        steeper = task.with_blocking(graph, patches)
        if not steeper.tangles():
            return steeper
    for height in BANDS_MM if cut else ():
        report(Progress("ordering", 0.35))
        tangled = {node for nodes in graph.tangles() for node in nodes}
        patches = []
        for node, patch in enumerate(graph.patches):
            if node not in tangled:
                patches.append(patch)
                continue
            low, high = patch.vertices[:, 2].min(), patch.vertices[:, 2].max()
            first = task.cell.placement.plate_z_mm + height
            cuts = np.arange(first, high - 0.3 * height, height)
            patches += bands(patch, [float(z) for z in cuts if z > low + 0.3 * height])
        if len(patches) > MOST_PATCHES:
            break
        if len(patches) > len(graph.patches):
            graph = task.with_blocking(task.graph(patches))
        if not graph.tangles():
            break
    return graph


def _raised(patch: Patch, most: float) -> Patch:
    tilt = np.minimum(tilt_of(patch.tool_axes), most)
    return replace(patch, tool_axes=tilted(patch.tool_axes, tilt))


@dataclass(frozen=True, eq=False)
class _Proven:
    """An order with its outcome, everything by position in the order."""

    patches: tuple[Patch, ...]
    supports: Floats
    blocks: Floats
    bad: tuple[Bools, ...]
    colliding: Floats
    floating: Floats

    @property
    def cost(self) -> float:
        """Area [mm²] that collides or floats."""
        return float(self.colliding.sum() + self.floating.sum())


def _proven(task: _Task, graph: _Graph, order: list[int], report: Report) -> _Proven:
    """Check every patch against what is there when it is printed; raise where needed."""
    count = len(order)
    patches = [graph.patches[node] for node in order]
    stages = []
    chosen = np.zeros(count, np.bool_)
    for node in order:
        stages.append(chosen.copy())
        chosen[node] = True
    stages.append(chosen)
    material = graph.material
    judged = task.assessment
    same = judged is not None and material is judged.material

    def check(at: int) -> tuple[Patch, Bools]:
        patch = patches[at]
        if same and judged is not None:
            # the patches are the sheets: where one was judged against just what is there,
            # that outcome is taken
            side = judged.sheets[order[at]].outside
            if np.array_equal(stages[at], printed_before(task.stack, order[at])) and (
                np.array_equal(patch.tool_axes, side.axes)
            ):
                return patch, ~side.clear
        return _cleared(task, patch, material, stages[at], stages[at + 1])

    done: list[tuple[Patch, Bools]] = []
    for first in range(0, count, 8):
        last = min(first + 8, count)
        if not same:
            material.prepare(stages[max(first, 1) : last + 1])
        done += map_threads(check, range(first, last))
        if not same:
            material.forget(stages[max(first, 1) : last])
        report(Progress("ordering", 0.4 + 0.6 * last / count))
    rank = np.empty(count, np.int64)
    rank[order] = np.arange(count)
    moved = np.ix_(order, order)
    bad = tuple(hit for _, hit in done)
    return _Proven(
        patches=tuple(patch for patch, _ in done),
        supports=graph.support.share[moved],
        blocks=graph.blocked[moved],
        bad=bad,
        colliding=np.array([_bad_area(patch, hit) for patch, hit in done]),
        floating=_floating(graph.samples, graph.support, rank, count),
    )


def _cleared(
    task: _Task, patch: Patch, material: Material, before: Bools, after: Bools
) -> tuple[Patch, Bools]:
    """Check a patch against the material of others and its own; raise the tool where needed.

    Returns:
        The patch, perhaps with other axes, and the vertices that stay unclear.
    """
    settings, tool = task.settings, task.tool
    bulk = ToolShape.of(task.cell.tool, OWN_LAYER_MM)
    fields = [
        (task.surroundings, tool),
        (material.field_of(before), tool),
        (material.field_of(after), bulk),
    ]
    wanted = settings.clearance_mm

    def clearance(index: Ints, tips: Floats, axes: Floats) -> Floats:
        gap = np.full(len(tips), np.inf)
        for field, shape in fields:
            gap = np.minimum(gap, field.clearance(shape, tips, axes, wanted, wanted))
        return gap

    gap = clearance(np.arange(len(patch.vertices)), patch.vertices, patch.tool_axes)
    limit = plate_tilt_limit(
        patch.vertices, patch.vertex_normals, patch.thickness, tool, task.cell, wanted,
        None if task.assessment is None else task.assessment.width_mm,
    )  # fmt: skip
    tilt = tilt_of(patch.tool_axes)
    hit = (gap < wanted) | (tilt > limit + 1e-6)
    if not hit.any() or settings.orientation != "collision-free":
        return patch, hit
    todo = np.flatnonzero(hit)
    start = np.clip(tilt[todo], 0.0, np.maximum(limit[todo], 0.0))
    # the azimuth is the axis's own; an upright axis has none and stays
    raised, found = raise_until_clear(
        patch.vertices[todo],
        patch.tool_axes[todo],
        start,
        lambda index, tips, axes: clearance(todo[index], tips, axes),
        wanted,
    )
    new = tilt.copy()
    new[todo[found]] = raised[found]
    kept = ~hit
    kept[todo[found]] = True
    axes, clear = smoothed(
        patch.vertices, patch.faces, patch.tool_axes, new, kept, limit, clearance, settings
    )
    return replace(patch, tool_axes=axes), ~clear


def _floating(samples: Samples, support: Support, rank: Ints, count: int) -> Floats:
    """Area of each patch, by position, that has nothing under it when it is printed."""
    area = np.zeros(count)
    late = (support.share > SUPPORT_SHARE) & (rank[:, None] > rank[None, :])
    # of two that lie on each other one has to come first
    late &= ~(support.share < support.share.T)
    for node in range(count):
        own = samples.patch == node
        total = float(samples.area[own].sum())
        loose = float(samples.area[own & support.floating].sum())
        loose += total * float(support.share[late[:, node], node].sum())
        # less than this is the grain of samples and voxels at the patch's rim
        area[rank[node]] = loose if loose > FLOATING_SHARE * total else 0.0
    return area


def _bad_area(patch: Patch, hit: Bools) -> float:
    if not hit.any():
        return 0.0
    return float((patch.face_areas * hit[patch.faces].mean(1)).sum())


def _base_report(assessment: Assessment | None) -> PrintabilityReport:
    if assessment is not None:
        return assessment.report
    return PrintabilityReport("fully", 1.0, 1.0, 1.0)


def _with_sequence(base: PrintabilityReport, proven: _Proven) -> PrintabilityReport:
    """Add to a report what only the sequence shows."""
    patches = proven.patches
    total = sum(patch.area for patch in patches)
    reasons = list(base.reasons)
    lost = 0.0
    for patch, hit in zip(patches, proven.bad):
        area = _bad_area(patch, hit)
        if area > 1.0:
            lost += area
            middle = patch.vertices[hit].mean(0)
            remedy = "split the layer lower, or choose another restraint region (--brr)"
            where = (float(middle[0]), float(middle[1]), float(middle[2]))
            reasons.append(Reason("printed_part", patch.layer, area, where, remedy))
    for patch, area in zip(patches, proven.floating):
        if area > 1.0:
            middle = patch.vertices.mean(0)
            where = (float(middle[0]), float(middle[1]), float(middle[2]))
            remedy = "a substrate under it (vega substrate), or --brr down"
            reasons.append(Reason("no_support", patch.layer, float(area), where, remedy))
    reasons.sort(key=lambda reason: (-reason.area_mm2, reason.layer, reason.code))
    assert all(reason.code in REASON_CODES for reason in reasons)
    return replace(
        base,
        collision_free_ratio=min(base.collision_free_ratio, 1 - lost / max(total, 1e-300)),
        reasons=tuple(reasons),
    )
