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
    OUTSIDE,
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


#: Share of a sheet's vertices that may be unclear in an order that is taken as it comes.
UNCLEAR_SHARE = 0.02

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
        for a, b in zip(*np.nonzero(self.supports > SUPPORT_SHARE)):
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

    Returns:
        The patches in print order with the proof.
    """
    patches = list(patches)
    count = given = len(patches)
    tool = ToolShape.of(cell.tool)
    if assessment is not None:
        surroundings = assessment.surroundings
    elif cell.substrate is not None:
        surroundings = mesh_field(cell.substrate, stage_height(stack))
    else:
        surroundings = EMPTY
    if not count:
        empty = np.zeros((0, 0))
        base = _base_report(assessment)
        return PrintOrder((), empty, empty, np.zeros(0), np.zeros(0), base)
    whole = assessment is not None and _are_sheets(patches, stack)
    material = assessment.material if assessment is not None and whole else None
    natural = assessment is not None and _one_sided(assessment)
    graph = _Graph.of(
        patches, stack, cell, surroundings, tool, settings, material, block=not natural
    )
    report(Progress("ordering", 0.3))
    if natural:
        # the assessment has proven every sheet clear of all that is laid before it
        order = _natural_order(patches, stack)
    else:
        if graph.tangles() and settings.orientation == "collision-free":
            graph = _untangled(graph, stack, cell, surroundings, tool, settings, report)
        whole = whole and graph.material is material
        before, _ = break_cycles(graph.hard, graph.soft)
        order = sequence(before, _keys(graph.patches, stack))
    count = len(graph.patches)
    material, samples, support = graph.material, graph.samples, graph.support
    blocked, hard = graph.blocked, graph.hard
    report(Progress("ordering", 0.4))
    patches = [graph.patches[node] for node in order]
    rank = np.empty(count, np.int64)
    rank[order] = np.arange(count)
    judged = assessment if whole else None
    proven, bad = _prove(
        patches, order, stack, material, surroundings, judged, cell, settings, report
    )
    floating = _floating(samples, support, rank, hard, count)
    moved = np.ix_(order, order)
    base = _base_report(assessment)
    if count > given and base.status == "fully":
        base = replace(base, status="conditionally")
    final = _with_sequence(base, proven, bad, floating, cell)
    colliding = np.array([_bad_area(patch, mask) for patch, mask in zip(proven, bad)])
    return PrintOrder(
        tuple(proven), support.share[moved], blocked[moved], colliding, floating, final
    )


def _are_sheets(patches: Sequence[Patch], stack: LayerStack) -> bool:
    """Tell whether the patches are the sheets, whole and in their order."""
    return len(patches) == len(stack.sheets) and all(
        patch.layer == number
        and np.array_equal(patch.faces, sheet.faces)
        and np.array_equal(patch.vertices, sheet.vertices)
        for number, (patch, sheet) in enumerate(zip(patches, stack.sheets))
    )


def _one_sided(assessment: Assessment) -> bool:
    """Tell whether all is printed from outside, clear of what the sheets before leave."""
    return all(
        (sheet.side == OUTSIDE).all() and sheet.outside.clear.mean() > 1 - UNCLEAR_SHARE
        for sheet in assessment.sheets
    )


def _natural_order(patches: Sequence[Patch], stack: LayerStack) -> list[int]:
    """Sheets from the inside out, or from the bottom up; in a sheet the lowest piece first."""

    def key(node: int) -> tuple:
        sheet = patches[node].layer
        turn = sheet if stack.sheets[sheet].kind == "planar" else -sheet
        return turn, round(float(patches[node].vertices[:, 2].min()), 6), node

    return sorted(range(len(patches)), key=key)


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

    @classmethod
    def of(
        cls,
        patches: Sequence[Patch],
        stack: LayerStack,
        cell: Workcell,
        surroundings: DistanceField,
        tool: ToolShape,
        settings: PrintabilitySettings,
        material: Material | None = None,
        block: bool = True,
    ) -> _Graph:
        count = len(patches)
        if material is None:
            material = Material(stack.part, patches, stage_height(stack))
        owner = np.repeat(np.arange(count), np.diff(material.first))
        samples = sample_patches(patches)
        support = find_support(
            samples, count, material, owner, surroundings, cell.placement.plate_z_mm
        )
        blocked = np.zeros((count, count))
        if block:
            blocked = find_blocking(samples, samples, count, tool, settings.clearance_mm)
        return cls(tuple(patches), material, samples, support, blocked)

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


def _untangled(
    graph: _Graph,
    stack: LayerStack,
    cell: Workcell,
    surroundings: DistanceField,
    tool: ToolShape,
    settings: PrintabilitySettings,
    report: Report,
) -> _Graph:
    """Resolve cycles: first by steeper tool axes, then by cutting into bands of height."""
    for most_deg in TILTS_DEG:
        patches = list(graph.patches)
        for nodes in graph.tangles():
            for node in nodes:
                patches[node] = _raised(patches[node], np.radians(most_deg), settings)
        samples = sample_patches(patches)
        blocked = find_blocking(samples, samples, len(patches), tool, settings.clearance_mm)
        steeper = replace(graph, patches=tuple(patches), samples=samples, blocked=blocked)
        if not steeper.tangles():
            return steeper
    for height in BANDS_MM:
        report(Progress("ordering", 0.35))
        tangled = {node for nodes in graph.tangles() for node in nodes}
        patches = []
        for node, patch in enumerate(graph.patches):
            if node not in tangled:
                patches.append(patch)
                continue
            low, high = patch.vertices[:, 2].min(), patch.vertices[:, 2].max()
            first = cell.placement.plate_z_mm + height
            cuts = np.arange(first, high - 0.3 * height, height)
            patches += bands(patch, [float(z) for z in cuts if z > low + 0.3 * height])
        if len(patches) > MOST_PATCHES:
            break
        if len(patches) > len(graph.patches):
            graph = _Graph.of(patches, stack, cell, surroundings, tool, settings)
        if not graph.tangles():
            break
    return graph


def _raised(patch: Patch, most: float, settings: PrintabilitySettings) -> Patch:
    tilt = np.minimum(tilt_of(patch.tool_axes), most)
    return replace(patch, tool_axes=tilted(patch.tool_axes, tilt))


def _prove(
    patches: list[Patch],
    order: list[int],
    stack: LayerStack,
    material: Material,
    surroundings: DistanceField,
    judged: Assessment | None,
    cell: Workcell,
    settings: PrintabilitySettings,
    report: Report,
) -> tuple[list[Patch], list[Bools]]:
    """Check every patch against what is there when it is printed; raise where needed.

    Where the patches are the sheets and `judged` has judged one against just what is
    there, that outcome is taken.
    """
    tool = ToolShape.of(cell.tool)
    bulk = ToolShape.of(cell.tool, OWN_LAYER_MM)
    count = len(patches)
    stages = []
    chosen = np.zeros(count, np.bool_)
    for node in order:
        stages.append(chosen.copy())
        chosen[node] = True
    stages.append(chosen)

    def known(at: int) -> Bools | None:
        sheet = order[at]
        if judged is None or not np.array_equal(stages[at], printed_before(stack, sheet)):
            return None
        if not np.array_equal(patches[at].tool_axes, judged.sheets[sheet].outside.axes):
            return None
        return ~judged.sheets[sheet].outside.clear

    def check(at: int) -> tuple[Patch, Bools]:
        patch = patches[at]
        outcome = known(at)
        if outcome is not None:
            return patch, outcome
        fields = [(surroundings, tool)]
        if at:
            fields.append((material.field_of(stages[at]), tool))
        fields.append((material.field_of(stages[at + 1]), bulk))

        def clearance(index: Ints, tips: Floats, axes: Floats) -> Floats:
            gap = np.full(len(tips), np.inf)
            for field, shape in fields:
                gap = np.minimum(
                    gap,
                    field.clearance(
                        shape, tips, axes, settings.clearance_mm, settings.clearance_mm
                    ),
                )
            return gap

        every = np.arange(len(patch.vertices))
        gap = clearance(every, patch.vertices, patch.tool_axes)
        limit = plate_tilt_limit(
            patch.vertices,
            patch.vertex_normals,
            patch.thickness,
            tool,
            cell,
            settings.clearance_mm,
        )
        tilt = tilt_of(patch.tool_axes)
        hit = (gap < settings.clearance_mm) | (tilt > limit + 1e-6)
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
            settings.clearance_mm,
        )
        new = tilt.copy()
        new[todo[found]] = raised[found]
        kept = ~hit
        kept[todo[found]] = True
        axes, clear = smoothed(
            patch.vertices,
            patch.faces,
            patch.tool_axes,
            new,
            kept,
            limit,
            clearance,
            settings,
        )
        return replace(patch, tool_axes=axes), ~clear

    done: list[tuple[Patch, Bools]] = []
    for first in range(0, count, 8):
        last = min(first + 8, count)
        if judged is None:
            material.prepare(stages[max(first, 1) : last + 1])
        done += map_threads(check, range(first, last))
        if judged is None:
            material.forget(stages[max(first, 1) : last])
        report(Progress("ordering", 0.4 + 0.6 * last / count))
    return [patch for patch, _ in done], [hit for _, hit in done]


def _floating(samples: Samples, support: Support, rank: Ints, hard: Bools, count: int) -> Floats:
    """Area of each patch, by position, that has nothing under it when it is printed."""
    area = np.zeros(count)
    late = (support.share > SUPPORT_SHARE) & (rank[:, None] > rank[None, :])
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


def _with_sequence(
    base: PrintabilityReport,
    patches: Sequence[Patch],
    bad: Sequence[Bools],
    floating: Floats,
    cell: Workcell,
) -> PrintabilityReport:
    """Add to a report what only the sequence shows."""
    total = sum(patch.area for patch in patches)
    reasons = list(base.reasons)
    lost = 0.0
    for patch, hit in zip(patches, bad):
        area = _bad_area(patch, hit)
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
            remedy = "a substrate under it (vega substrate), or --brr down"
            reasons.append(Reason("no_support", patch.layer, float(area), where, remedy))
    reasons.sort(key=lambda reason: (-reason.area_mm2, reason.layer, reason.code))
    status = base.status
    if lost > 2e-3 * total:
        status = "not"
    assert all(reason.code in REASON_CODES for reason in reasons)
    return replace(
        base,
        status=status,
        collision_free_ratio=min(base.collision_free_ratio, 1 - lost / max(total, 1e-300)),
        reasons=tuple(reasons),
    )
