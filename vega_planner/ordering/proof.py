# SPDX-License-Identifier: Apache-2.0
"""Prove an order: every patch against what is there when it is printed."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints, Patch
from vega_planner.ordering.dependencies import Support
from vega_planner.ordering.samples import Samples
from vega_planner.ordering.task import SUPPORT_SHARE, Graph, OrderTask
from vega_planner.parallel import map_threads
from vega_planner.printability.assessment import OWN_LAYER_MM, plate_tilt_limit, printed_before
from vega_planner.printability.material import EMPTY, Material
from vega_planner.printability.orientation import raise_until_clear, smoothed, tilt_of
from vega_planner.printability.tool_shape import ToolShape
from vega_planner.progress import Progress, Report

#: Share of a patch without anything under it that is told.
FLOATING_SHARE = 0.05

#: Moments at most at which what is there is looked at while an order is proven. Of many
#: small pieces some that follow each other share one: of those, each is held against the
#: others like against its own layer only, and the check of every waypoint does the rest.
MOST_STAGES = 300


@dataclass(frozen=True, eq=False)
class Proven:
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


def proven_order(
    task: OrderTask, graph: Graph, order: list[int], report: Report, most_mm2: float = np.inf
) -> Proven | None:
    """Check every patch against what is there when it is printed; raise where needed.

    Args:
        task: What stays the same while orders are tried.
        graph: The patches.
        order: Their numbers in print order.
        report: Receives progress; may raise `Cancelled`.
        most_mm2: Area that may collide or float; an order of more is given up.

    Returns:
        The outcome; None where the order was given up.
    """
    count = len(order)
    rank = np.empty(count, np.int64)
    rank[order] = np.arange(count)
    floating = _floating(graph.samples, graph.support, rank, count)
    cost = float(floating.sum())
    if cost > most_mm2:
        return None
    patches = [graph.patches[node] for node in order]
    # what is there before and after each patch; small pieces share that with their neighbours
    group = -(-count // MOST_STAGES)
    begins = [at - at % group for at in range(count)]
    ends = [min(begin + group, count) for begin in begins]
    stages = {}
    chosen = np.zeros(count, np.bool_)
    for at, node in enumerate(order):
        if at % group == 0:
            stages[at] = chosen.copy()
        chosen[node] = True
    stages[count] = chosen
    material = graph.material
    judged = task.assessment
    same = judged is not None and material is judged.material

    def check(at: int) -> tuple[Patch, Bools]:
        patch = patches[at]
        if same and judged is not None:
            # the patches are the sheets: where one was judged against just what is there,
            # that outcome is taken
            side = judged.sheets[order[at]].outside
            before = stages[begins[at]]
            if np.array_equal(before, printed_before(task.stack, order[at])) and (
                np.array_equal(patch.tool_axes, side.axes)
            ):
                return patch, ~side.clear
        return _cleared(task, patch, material, stages[begins[at]], stages[ends[at]])

    done: list[tuple[Patch, Bools]] = []
    for first in range(0, count, 8 * group):
        last = min(first + 8 * group, count)
        steps = [at for at in range(first, last, group) if at > 0]
        if not same:
            material.prepare([stages[at] for at in (*steps, last)])
        done += map_threads(check, range(first, last))
        cost += sum(bad_area(patch, hit) for patch, hit in done[first:last])
        if not same:
            material.forget([stages[at] for at in steps])
        report(Progress("ordering", 0.4 + 0.6 * last / count))
        if cost > most_mm2:
            return None
    moved = np.ix_(order, order)
    bad = tuple(hit for _, hit in done)
    return Proven(
        patches=tuple(patch for patch, _ in done),
        supports=graph.support.share[moved],
        blocks=graph.blocked[moved],
        bad=bad,
        colliding=np.array([bad_area(patch, hit) for patch, hit in done]),
        floating=floating,
    )


def _cleared(
    task: OrderTask, patch: Patch, material: Material, before: Bools, after: Bools
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
        todo = np.arange(len(tips))
        for field, shape in fields:
            if field is not EMPTY and len(todo):
                there = field.clearance(shape, tips[todo], axes[todo], wanted, wanted)
                gap[todo] = np.minimum(gap[todo], there)
                todo = todo[there >= wanted]
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


def bad_area(patch: Patch, hit: Bools) -> float:
    """Area of a patch at the vertices that are hit [mm²]."""
    if not hit.any():
        return 0.0
    return float((patch.face_areas * hit[patch.faces].mean(1)).sum())
