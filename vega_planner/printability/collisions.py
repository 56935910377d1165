# SPDX-License-Identifier: Apache-2.0
"""The check of every waypoint: the solid tool against all that is there at that moment."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from vega_planner.datatypes import (
    Bools,
    Floats,
    Ints,
    LayerStack,
    Patch,
    PrintabilityReport,
    Reason,
    ToolpathSet,
)
from vega_planner.parallel import map_threads
from vega_planner.printability import bead_kernels
from vega_planner.printability.assessment import stage_height
from vega_planner.printability.certificate import certificate
from vega_planner.printability.material import EMPTY, DistanceField, grid_for, mesh_field
from vega_planner.printability.tool_shape import STEP_MM, ToolShape
from vega_planner.progress import Progress, Report
from vega_planner.settings import PrintabilitySettings

if TYPE_CHECKING:
    from vega_planner.robot.workcell import Workcell

__all__ = ["CollisionCheck", "certificate", "check_toolpaths", "with_check"]

#: On travel, the tip counts too once it is this far from both ends [mm].
FREE_MM = 2.5

#: Number of a voxel no bead fills.
_NEVER = np.iinfo(np.int32).max


@dataclass(frozen=True, eq=False)
class CollisionCheck:
    """Outcome of the check of all waypoints.

    Attributes:
        checked: Number of waypoints checked, printing and travel.
        path: Pass of each colliding waypoint; travel before pass i is -1 - i. Shape (k,).
        waypoint: Index of it within its pass or travel, shape (k,).
        depth_mm: How deep the tool is in what it hits, shape (k,).
        obstacle: What it hits: "plate", "substrate" or "printed_part", length k.
        points: Tips of the colliding waypoints [mm], part frame, shape (k, 3).
    """

    checked: int
    path: Ints
    waypoint: Ints
    depth_mm: Floats
    obstacle: tuple[str, ...]
    points: Floats

    @property
    def colliding(self) -> int:
        """Number of colliding waypoints."""
        return len(self.path)

    def of_passes(self, toolpaths: ToolpathSet) -> list[Ints]:
        """Colliding waypoints of each pass, rising.

        Where a move collides as it begins, that is the end of the pass before it, with all
        of its own bead there.
        """
        hits = [np.sort(self.waypoint[self.path == n]) for n in range(len(toolpaths.passes))]
        for number in -1 - self.path[(self.path < -1) & (self.waypoint == 0)]:
            last = len(toolpaths.passes[number - 1].points) - 1
            hits[number - 1] = np.union1d(hits[number - 1], [last])
        return hits

    def of_travels(self) -> dict[int, Ints]:
        """Colliding waypoints of the moves that collide on their way, rising."""
        on_way = (self.path < 0) & ((self.waypoint > 0) | (self.path == -1))
        numbers = np.unique(-1 - self.path[on_way])
        return {int(n): np.sort(self.waypoint[on_way & (self.path == -1 - n)]) for n in numbers}

    def summary(self) -> dict[str, Any]:
        """Tell the outcome in plain values, as `summary.json` and the certificate hold it."""
        return {
            "checked_waypoints": self.checked,
            "colliding_waypoints": self.colliding,
            "colliding_travel_waypoints": int((self.path < 0).sum()),
            "deepest_mm": round(float(self.depth_mm.max()), 3) if self.colliding else 0.0,
            "obstacles": {name: self.obstacle.count(name) for name in sorted(set(self.obstacle))},
        }


def with_check(report: PrintabilityReport, check: CollisionCheck) -> PrintabilityReport:
    """Take the outcome of the final check into the report: what collides is not printable.

    The check of every waypoint has the last word over the order's, which judges patches by
    their vertices before any path is laid.
    """
    if not check.colliding:
        kept = tuple(reason for reason in report.reasons if reason.code != "printed_part")
        return replace(report, reasons=kept)
    reasons = list(report.reasons)
    for name in sorted(set(check.obstacle)):
        chosen = np.array([word == name for word in check.obstacle])
        worst = check.points[chosen][int(np.argmax(check.depth_mm[chosen]))]
        where = (float(worst[0]), float(worst[1]), float(worst[2]))
        remedy = (
            f"{int(chosen.sum())} waypoints collide, the deepest by "
            f"{float(check.depth_mm[chosen].max()):.2f} mm: a slimmer tool, another restraint "
            "region (--brr) or thinner layers"
        )
        reasons.append(Reason(name, -1, 0.0, where, remedy))
    return replace(report, status="not", reasons=tuple(reasons))


@dataclass(frozen=True, eq=False)
class _Waypoints:
    """All waypoints in the order they are run through."""

    points: Floats
    axes: Floats
    path: Ints
    index: Ints
    free: Bools
    first: Ints  # per pass, number of its first waypoint


def check_toolpaths(
    toolpaths: ToolpathSet,
    patches: Sequence[Patch],
    stack: LayerStack,
    cell: Workcell,
    settings: PrintabilitySettings,
    report: Report,
) -> CollisionCheck:
    """Check the solid tool at every printing and travel waypoint.

    What is there: the beads laid before the waypoint, the substrate and the plate.
    Against beads and substrate the first `TIP_MM` of the nozzle do not count while it
    prints, approaches or leaves, since the tip stands in its own bead.

    Args:
        toolpaths: Passes and travel.
        patches: Patches in print order.
        stack: The layers.
        cell: Tool, placement and substrate.
        settings: Printability settings.
        report: Receives progress; may raise `Cancelled`.

    Returns:
        The colliding waypoints; a waypoint collides where the tool and something else
        share space.
    """
    del patches
    way = _waypoints(toolpaths)
    near, whole = ToolShape.of(cell.tool), ToolShape.of(cell.tool, 0.0)
    finest = stage_height(stack)
    gap = near.height_above(way.points, way.axes) - cell.placement.plate_z_mm
    name = np.where(gap < 0, "plate", "").astype(object)
    if cell.substrate is not None:
        field = mesh_field(cell.substrate, finest)
        other = _clearance(field, near, whole, way, np.arange(len(gap)))
        name[(other < 0) & (other < gap)] = "substrate"
        gap = np.minimum(gap, other)
    if toolpaths.passes:
        beads = _Beads(toolpaths, way, finest)
        stages = _stages(toolpaths, way)
        for first in range(0, len(stages), 8):
            pieces = stages[first : first + 8]
            for (begin, end), other in zip(
                pieces,
                map_threads(lambda stage: _check_stage(beads, near, whole, way, *stage), pieces),
            ):
                hit = (other < 0) & (other < gap[begin:end])
                name[begin:end][hit] = "printed_part"
                gap[begin:end] = np.minimum(gap[begin:end], other)
            report(Progress("checks", min(1.0, (first + 8) / len(stages))))
    bad = np.flatnonzero(gap < -1e-9)
    return CollisionCheck(
        checked=len(gap),
        path=way.path[bad],
        waypoint=way.index[bad],
        depth_mm=-gap[bad],
        obstacle=tuple(str(word) for word in name[bad]),
        points=way.points[bad],
    )


def _waypoints(toolpaths: ToolpathSet) -> _Waypoints:
    points, axes, path, index, free, first = [], [], [], [], [], []
    count = 0
    for number, move in enumerate(toolpaths.travels):
        points.append(move.points)
        axes.append(move.axes)
        path.append(np.full(len(move.points), -1 - number))
        index.append(np.arange(len(move.points)))
        away = np.ones(len(move.points), np.bool_)
        for end in (0, -1):
            away &= np.linalg.norm(move.points - move.points[end], axis=1) > FREE_MM
        free.append(away)
        count += len(move.points)
        if number < len(toolpaths.passes):
            way = toolpaths.passes[number]
            points.append(way.points)
            axes.append(way.axes)
            path.append(np.full(len(way.points), number))
            index.append(np.arange(len(way.points)))
            free.append(np.zeros(len(way.points), np.bool_))
            first.append(count)
            count += len(way.points)
    if not points:
        none = np.zeros((0, 3))
        empty = np.zeros(0, np.int64)
        return _Waypoints(none, none, empty, empty, np.zeros(0, np.bool_), empty)
    return _Waypoints(
        np.concatenate(points),
        np.concatenate(axes),
        np.concatenate(path),
        np.concatenate(index),
        np.concatenate(free),
        np.array(first, np.int64),
    )


class _Beads:
    """The beads on a grid, each voxel with the number of the waypoint that lays it."""

    def __init__(self, toolpaths: ToolpathSet, way: _Waypoints, finest_mm: float) -> None:
        low = np.min([path.points.min(0) for path in toolpaths.passes], axis=0)
        high = np.max([path.points.max(0) for path in toolpaths.passes], axis=0)
        size = max(float(path.width.max()) for path in toolpaths.passes)
        self.origin, self.spacing, shape = grid_for(low - 0.5 * size, high + 0.5 * size, finest_mm)
        self.birth = np.full(shape, _NEVER, np.int32)
        for path, first in zip(toolpaths.passes, way.first):
            bead_kernels.lay_bead(
                path.points, path.axes, path.width, path.height, first, self.origin,
                self.spacing, self.birth,
            )  # fmt: skip

    def field(self, until: int) -> DistanceField | None:
        """Distance field of what is laid before a waypoint; None where that is nothing."""
        solid = self.birth < until
        if not solid.any():
            return None
        return DistanceField.of(solid, self.origin, self.spacing)


class Surroundings:
    """What is there at any moment of a print, for trying other tool poses.

    Args:
        toolpaths: Passes and travel.
        stack: The layers.
        cell: Tool, placement and substrate.
    """

    def __init__(self, toolpaths: ToolpathSet, stack: LayerStack, cell: Workcell) -> None:
        self._way = _waypoints(toolpaths)
        self._near = ToolShape.of(cell.tool)
        self._whole = ToolShape.of(cell.tool, 0.0)
        self._plate = cell.placement.plate_z_mm
        finest = stage_height(stack)
        self._fixed = EMPTY if cell.substrate is None else mesh_field(cell.substrate, finest)
        self._beads = _Beads(toolpaths, self._way, finest)
        starts = np.flatnonzero(np.diff(self._way.path, prepend=np.iinfo(np.int64).min))
        self._first = {int(self._way.path[k]): int(k) for k in starts}

    def first_of(self, path: int) -> int:
        """Number of the first waypoint of a pass, or of travel -1 - path."""
        return self._first[path]

    def is_free(self, number: int) -> bool:
        """Tell whether the tip counts at a waypoint, since it travels."""
        return bool(self._way.free[number])

    def at(self, number: int) -> Callable[[Floats, Floats, Bools], Floats]:
        """Make a check of poses against what is there before a waypoint.

        Returns:
            A function of tips [mm], axes, and whether the tip counts, that gives the
            clearance [mm] of each pose.
        """
        beads = self._beads.field(number) or EMPTY

        def clearance(tips: Floats, axes: Floats, free: Bools) -> Floats:
            gap = self._near.height_above(tips, axes) - self._plate
            for shape, chosen in ((self._near, ~free), (self._whole, free)):
                if chosen.any():
                    for field in (beads, self._fixed):
                        other = field.clearance(shape, tips[chosen], axes[chosen], 0.5)
                        gap[chosen] = np.minimum(gap[chosen], other)
            return gap

        return clearance


def _stages(toolpaths: ToolpathSet, way: _Waypoints) -> list[tuple[int, int]]:
    """Ranges of waypoints that print one patch, each with the travel that leads to it."""
    starts = [0]
    for number in range(1, len(toolpaths.passes)):
        if toolpaths.passes[number].patch != toolpaths.passes[number - 1].patch:
            last = toolpaths.passes[number - 1]
            starts.append(int(way.first[number - 1]) + len(last.points))
    return list(zip(starts, [*starts[1:], len(way.points)]))


def _check_stage(
    beads: _Beads, near: ToolShape, whole: ToolShape, way: _Waypoints, begin: int, end: int
) -> Floats:
    """Clearance from printed material of the waypoints begin to end [mm]."""
    index = np.arange(begin, end)
    field = beads.field(end)
    if field is None:
        return np.full(end - begin, np.inf)
    gap = _clearance(field, near, whole, way, index)
    # what collides with the patch as a whole may still be clear of what of it is there
    doubt = index[gap < 0]
    if not len(doubt):
        return gap
    before = beads.field(begin)
    exact = np.full(len(doubt), np.inf)
    if before is not None:
        exact = _clearance(before, near, whole, way, doubt)
    open_ = exact >= 0
    if open_.any():
        todo = doubt[open_]
        depth = np.empty(len(todo))
        for shape, chosen in ((near, ~way.free[todo]), (whole, way.free[todo])):
            if not chosen.any():
                continue
            out = np.empty(int(chosen.sum()))
            poses = todo[chosen]
            bead_kernels.depth_in_tool(
                way.points[poses], way.axes[poses], poses, np.full(len(poses), begin),
                beads.birth, beads.origin, beads.spacing, shape.start_mm, STEP_MM,
                shape.inscribed, shape.samples, out,
            )  # fmt: skip
            depth[chosen] = out
        exact[open_] = np.minimum(exact[open_], -depth)
    gap[doubt - begin] = exact
    return gap


def _clearance(
    field: DistanceField, near: ToolShape, whole: ToolShape, way: _Waypoints, index: Ints
) -> Floats:
    """Clearance of waypoints from a field: the tip counts on free travel only."""
    gap = np.empty(len(index))
    free = way.free[index]
    for shape, chosen in ((near, ~free), (whole, free)):
        poses = index[chosen]
        gap[chosen] = field.clearance(shape, way.points[poses], way.axes[poses], 0.3)
    return gap
