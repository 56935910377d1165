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
    PrintabilityReport,
    Reason,
    ToolpathSet,
)
from vega_planner.printability.assessment import stage_height
from vega_planner.printability.beads import Beads
from vega_planner.printability.links import LinkPoses
from vega_planner.printability.material import EMPTY, mesh_field
from vega_planner.printability.tool_shape import ToolShape, tip_length
from vega_planner.progress import Progress, Report

if TYPE_CHECKING:
    from vega_planner.robot.workcell import Workcell

#: On travel, the tip counts too once it is this far from both ends [mm].
FREE_MM = 2.5

#: Beads are pressed into each other; the tool may be as deep in one and not collide [mm].
TOUCH_MM = 0.05

#: Where other poses are tried, how deep a bad one is does not matter beyond this [mm], nor
#: how far away a good one is beyond that.
GIVE_UP_MM, ENOUGH_MM = -0.02, 0.2

#: Colliding waypoints of one pass that are asked for what they hit, at most about.
HITS_LOOKED_AT = 20

#: Share of the part that may be left out of a print that is what was asked for; beyond which
#: other ways of printing are tried; and beyond which, with what no tool reaches, it is not
#: printable: the volume of a print is right to within as much.
NEXT_TO_NOTHING, LITTLE, TOO_MUCH = 0.001, 0.01, 0.02

#: Waypoints checked between two reports of progress.
AT_ONCE = 8192


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
        left_out_ratio: Volume of bead that was left out since it cannot be laid without
            touching, over the part's.
    """

    checked: int
    path: Ints
    waypoint: Ints
    depth_mm: Floats
    obstacle: tuple[str, ...]
    points: Floats
    left_out_ratio: float = 0.0

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
            "left_out_ratio": round(self.left_out_ratio, 6),
        }


def _status(report: PrintabilityReport, left_out: float) -> str:
    lost = report.unprintable_ratio + left_out
    if report.status == "fully" and left_out <= NEXT_TO_NOTHING:
        return "fully"
    if report.status == "not" and report.unprintable_ratio <= 0.0:
        return "not"
    return "conditionally" if lost <= TOO_MUCH else "not"


def too_much_left_out(check: CollisionCheck, report: PrintabilityReport) -> bool:
    """Tell whether more collides or had to be left out than the part can do without.

    That is next to nothing for one whose layers are printable as they are, and a little
    for one that is printable with conditions already.
    """
    most = NEXT_TO_NOTHING if report.status == "fully" else LITTLE
    return check.colliding > 0 or check.left_out_ratio > most


def with_check(
    report: PrintabilityReport, check: CollisionCheck, judged: Sequence[Reason] = ()
) -> PrintabilityReport:
    """Take the outcome of the final check into the report: what collides is not printable.

    The check of every waypoint has the last word over the order's, which judges patches by
    their vertices before any path is laid. What had to be left out for it counts: more than
    `NEXT_TO_NOTHING` of the part and it is printable with that condition only, more than
    `TOO_MUCH` together with what no tool reaches and it is not.

    Args:
        report: The report on layers and order.
        check: The check of every waypoint.
        judged: The reasons of the layers alone, which stay: what they tell of has no path.
    """
    if not check.colliding:
        kept = tuple(
            reason
            for reason in report.reasons
            if reason.code != "printed_part" or reason in judged
        )
        return replace(report, status=_status(report, check.left_out_ratio), reasons=kept)
    reasons = list(report.reasons)
    for name in sorted(set(check.obstacle)):
        chosen = np.array([word == name for word in check.obstacle])
        worst = check.points[chosen][int(np.argmax(check.depth_mm[chosen]))]
        where = (float(worst[0]), float(worst[1]), float(worst[2]))
        if name == "robot_body":  # told by the check of the links, sample by sample
            continue
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
    stack: LayerStack,
    cell: Workcell,
    report: Report,
    *,
    links: bool = False,
) -> CollisionCheck:
    """Check the solid tool at every printing and travel waypoint.

    What is there: the beads laid before the waypoint, the substrate and the plate.
    Against beads and substrate what is within `tip_length` of the tip does not count while
    the nozzle prints, approaches or leaves, since it stands in its own bead.

    Args:
        toolpaths: Passes and travel.
        stack: The layers.
        cell: Tool, placement and substrate.
        report: Receives progress; may raise `Cancelled`.
        links: Whether the robot's links count, too, where a pose leaves them no choice.

    Returns:
        The colliding waypoints; a waypoint collides where the tool and something else
        share space.
    """
    way = _waypoints(toolpaths)
    near = ToolShape.of(cell.tool, tip_length(stack.thickness_mm))
    whole = ToolShape.of(cell.tool, 0.0)
    finest = stage_height(stack)
    gap = near.height_above(way.points, way.axes) - cell.placement.plate_z_mm
    name = np.where(gap < 0, "plate", "").astype(object)
    if cell.substrate is not None:
        field = mesh_field(cell.substrate, finest)
        other = np.empty(len(gap))
        for shape, chosen in ((near, ~way.free), (whole, way.free)):
            other[chosen] = field.clearance(shape, way.points[chosen], way.axes[chosen], 0.3)
        name[(other < 0) & (other < gap)] = "substrate"
        gap = np.minimum(gap, other)
    beads = Beads(toolpaths.passes, way.first)
    for begin in range(0, len(gap), AT_ONCE):
        index = np.arange(begin, min(begin + AT_ONCE, len(gap)))
        for shape, chosen in ((near, ~way.free[index]), (whole, way.free[index])):
            at = index[chosen]
            other = beads.clearance(shape, way.points[at], way.axes[at], at, 0.0) + TOUCH_MM
            name[at[(other < 0) & (other < gap[at])]] = "printed_part"
            gap[at] = np.minimum(gap[at], other)
        report(Progress("checks", (begin + len(index)) / len(gap)))
    if links:
        at = np.flatnonzero(gap >= 0)
        held = LinkPoses(toolpaths, cell)
        at = at[held.touch(way.points[at], way.axes[at], _passes_there(way.path[at]))]
        gap[at], name[at] = -1.0, "robot_body"
    bad = np.flatnonzero(gap < -1e-9)
    return CollisionCheck(
        checked=len(gap),
        path=way.path[bad],
        waypoint=way.index[bad],
        depth_mm=-gap[bad],
        obstacle=tuple(str(word) for word in name[bad]),
        points=way.points[bad],
    )


def _passes_there(path: Ints) -> Ints:
    """Number of passes that are there at waypoints, by the pass or travel of each."""
    return np.where(path < 0, -1 - path, path)


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


class Surroundings:
    """What is there at any moment of a print, for trying other tool poses.

    Args:
        toolpaths: Passes and travel.
        stack: The layers.
        cell: Tool, placement and substrate.
        links: Whether the robot's links count, too.
    """

    def __init__(
        self, toolpaths: ToolpathSet, stack: LayerStack, cell: Workcell, links: bool = False
    ) -> None:
        self._way = _waypoints(toolpaths)
        self._near = ToolShape.of(cell.tool, tip_length(stack.thickness_mm))
        self._whole = ToolShape.of(cell.tool, 0.0)
        self._plate = cell.placement.plate_z_mm
        finest = stage_height(stack)
        self._fixed = EMPTY if cell.substrate is None else mesh_field(cell.substrate, finest)
        self._beads = Beads(toolpaths.passes, self._way.first)
        starts = np.flatnonzero(np.diff(self._way.path, prepend=np.iinfo(np.int64).min))
        self._first = {int(self._way.path[k]): int(k) for k in starts}
        self._links = LinkPoses(toolpaths, cell) if links else None
        #: Poses tried so far.
        self.tried = 0

    def first_of(self, path: int) -> int:
        """Number of the first waypoint of a pass, or of travel -1 - path."""
        return self._first[path]

    def is_free(self, number: int) -> bool:
        """Tell whether the tip counts at a waypoint, since it travels."""
        return bool(self._way.free[number])

    def hit_patches(self, toolpaths: ToolpathSet, check: CollisionCheck) -> set[tuple[int, int]]:
        """Find which patches the tool meets where passes collide with printed material.

        Args:
            toolpaths: The same toolpaths.
            check: The check of them.

        Returns:
            Pairs of the patch whose bead is hit and the patch that is being printed.
        """
        pairs = set()
        for number, hits in enumerate(check.of_passes(toolpaths)):
            for k in hits[:: max(1, len(hits) // HITS_LOOKED_AT)]:
                at = self._first[number] + int(k)
                bead = self._beads.nearest_to(
                    self._near, self._way.points[at], self._way.axes[at], at + 1
                )
                if bead >= 0:
                    other = toolpaths.passes[int(self._way.path[bead])]
                    pairs.add((other.patch, toolpaths.passes[number].patch))
        return pairs

    def at(self, number: int) -> Callable[[Floats, Floats, Bools], Floats]:
        """Make a check of poses against what is there before a waypoint.

        Returns:
            A function of tips [mm], axes, and whether the tip counts, that gives the
            clearance [mm] of each pose.
        """

        def clearance(tips: Floats, axes: Floats, free: Bools) -> Floats:
            return self.clearance(tips, axes, free, np.full(len(tips), number))

        return clearance

    def clearance(self, tips: Floats, axes: Floats, free: Bools, number: Ints) -> Floats:
        """Measure the clearance of poses, each at the time of a waypoint.

        Args:
            tips: Tips [mm], shape (n, 3).
            axes: Unit vectors from the tip back along the nozzle, shape (n, 3).
            free: Whether the tip counts, shape (n,).
            number: Numbers of the waypoints, shape (n,).

        Returns:
            Clearances [mm], exact only between `GIVE_UP_MM` and `ENOUGH_MM`, shape (n,).
        """
        self.tried += len(tips)
        gap = self._near.height_above(tips, axes) - self._plate
        for shape, chosen in ((self._near, ~free), (self._whole, free)):
            todo = np.flatnonzero(chosen & (gap >= 0))
            if self._fixed is not EMPTY:
                other = self._fixed.clearance(shape, tips[todo], axes[todo], ENOUGH_MM)
                gap[todo] = np.minimum(gap[todo], other)
                todo = todo[gap[todo] >= 0]
            other = self._beads.clearance(
                shape, tips[todo], axes[todo], number[todo], ENOUGH_MM, GIVE_UP_MM
            )
            gap[todo] = np.minimum(gap[todo], other)
        if self._links is not None:
            todo = np.flatnonzero(gap >= 0)
            now = _passes_there(self._way.path[number[todo]])
            gap[todo[self._links.touch(tips[todo], axes[todo], now)]] = -1.0
        return gap
