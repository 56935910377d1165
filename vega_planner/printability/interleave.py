# SPDX-License-Identifier: Apache-2.0
"""Interleave passes that stand in each other's way: cut them, and print what is free next.

Patches may wait for each other: each climbs past the place where the nozzle has to go for
the other. Patches that are cut into bands would have rims between the bands, and widths
that no number of beads fills; the print stays open there. So the passes are cut, not the
patches. Of all stretches the next is one that lies on what is there and keeps the nozzle
from nothing that is still to come; the same pass goes on as long as that is so. Where there
is no such stretch, the one that costs least goes next. What is deposited stays the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from vega_planner.datatypes import Bools, Floats, Toolpath
from vega_planner.printability.material import DistanceField
from vega_planner.printability.stretches import (
    Holding,
    Stations,
    Stretch,
    blocked_poses,
    stations_of,
    stretches_of,
    what_holds,
)
from vega_planner.printability.turning import arc_length
from vega_planner.progress import Progress, Report

if TYPE_CHECKING:
    from vega_planner.robot.workcell import Workcell

#: Share of a stretch that has to lie on something, as far as there is anything.
HELD_SHARE = 0.6

#: What a station with nothing under it costs, against a pose that will be in the way.
FLOATING_COST = 0.5

#: A stretch that costs less than this is free: not one pose.
FREE = 0.5

#: Two stretches of a patch that follow each other are joined where they end this near, in
#: bead widths, and their axes differ by no more than this [deg].
LINK_WIDTHS, LINK_DEG = 1.5, 20.0

#: Points nearer than this are one [mm].
_SAME_MM = 1e-3

#: Steps between two reports of progress.
_REPORT = 200


@dataclass
class Run:
    """Neighbouring stretches of one pass that are printed one after the other.

    Attributes:
        stretches: Their numbers.
        way: 1 along the pass, -1 against it.
    """

    stretches: list[int]
    way: int


@dataclass(frozen=True, eq=False)
class Interleaved:
    """Passes in an order that keeps the nozzle's way free.

    Attributes:
        passes: In print order; patches may alternate.
        floating_mm2: By patch of the passes, the area with nothing under it when it is
            printed.
        blocked_ratio: Share of the poses that meet what was printed before for want of
            anything better.
    """

    passes: list[Toolpath]
    floating_mm2: dict[int, float]
    blocked_ratio: float


def interleaved(
    passes: Sequence[Toolpath],
    cell: Workcell,
    surroundings: DistanceField,
    thickness_mm: float,
    report: Report,
) -> Interleaved:
    """Cut passes and put the stretches into an order that keeps the nozzle's way free.

    Args:
        passes: The passes, in an order that is as good as can be without cutting.
        cell: Tool and plate.
        surroundings: Distance field of the substrate.
        thickness_mm: Nominal thickness of the layers.
        report: Receives progress; may raise `Cancelled`.
    """
    if not passes:
        return Interleaved([], {}, 0.0)
    stretches = stretches_of(passes)
    stations = stations_of(passes, stretches)
    report(Progress("clearance", 0.1, detail="stretches"))
    blocked = blocked_poses(stations, len(stretches), cell, thickness_mm)
    plate = float(cell.placement.plate_z_mm)
    holding = what_holds(stations, len(stretches), surroundings, plate)
    report(Progress("clearance", 0.2, detail="stretches"))
    search = _Search(passes, stretches, stations, blocked, holding)
    runs = search.runs(report)
    joined = _joined(passes, stretches, runs)
    return Interleaved(joined, search.floating_by_patch(), search.blocked / len(stations.points))


class _Search:
    """Takes stretch after stretch; keeps what each costs while others are still to come."""

    def __init__(
        self,
        passes: Sequence[Toolpath],
        stretches: Sequence[Stretch],
        stations: Stations,
        blocked: np.ndarray,
        holding: Holding,
    ) -> None:
        count = len(stretches)
        self._passes, self._stretches, self._stations = passes, stretches, stations
        self._blocked, self._holding = blocked, holding
        self._number = np.array([stretch.number for stretch in stretches])
        self._begin = np.array([passes[s.number].points[s.first] for s in stretches])
        self._end = np.array([passes[s.number].points[s.last] for s in stretches])
        self._width = float(np.median(stations.width))
        self._todo = np.ones(count, np.bool_)
        #: Poses still to come that a stretch would be in the way of.
        self._harm = blocked.sum(0, dtype=np.float64)
        self._held = holding.held.copy()
        self._poses = np.bincount(stations.stretch, minlength=count).astype(float)
        self._bare = np.bincount(stations.stretch, ~self._held, count)
        self._floating = np.zeros(count, np.bool_)
        self._floats = holding.loose.copy()
        #: Poses in whose way something was printed.
        self.blocked = 0.0

    def runs(self, report: Report) -> list[Run]:
        """Order the stretches."""
        runs: list[Run] = []
        for step in range(len(self._stretches)):
            if step % _REPORT == 0:
                done = step / len(self._stretches)
                report(Progress("clearance", 0.2 + 0.8 * done, detail="stretches"))
            self._floating = self._bare > (1 - HELD_SHARE) * self._poses
            cost = self._harm + FLOATING_COST * np.where(self._floating, self._bare, 0.0)
            free = self._todo & (cost < FREE)
            if not (runs and self._goes_on(runs[-1], free)):
                if not free.any():
                    free = self._todo & (cost <= cost[self._todo].min())
                runs.append(self._begun(free, runs[-1] if runs else None))
            self._print(runs[-1].stretches[-1])
        return runs

    def _goes_on(self, run: Run, free: Bools) -> bool:
        """Lengthen a run, in the direction it has; one stretch may still turn round."""
        last = run.stretches[-1]
        for way in (run.way, -run.way) if len(run.stretches) == 1 else (run.way,):
            after = last + way
            inside = 0 <= after < len(free) and self._number[after] == self._number[last]
            if inside and free[after]:
                run.stretches.append(after)
                run.way = way
                return True
        return False

    def _begun(self, free: Bools, before: Run | None) -> Run:
        """Choose where to begin: of the earliest pass, near the last end, or the longest."""
        index = np.flatnonzero(free & (self._number == self._number[free].min()))
        starts = np.flatnonzero(np.diff(index, prepend=-2) > 1)
        first, last = index[starts], index[np.append(starts[1:], len(index)) - 1]
        best = int(np.add.reduceat(self._poses[index], starts).argmax())
        backwards = np.zeros(len(first), np.bool_)
        if before is not None:
            k = before.stretches[-1]
            at = self._end[k] if before.way > 0 else self._begin[k]
            to_first = np.linalg.norm(self._begin[first] - at, axis=1)
            to_last = np.linalg.norm(self._end[last] - at, axis=1)
            backwards = to_first > to_last
            away = np.minimum(to_first, to_last)
            if away.min() < LINK_WIDTHS * self._width:
                best = int(away.argmin())
        if backwards[best]:
            return Run([int(last[best])], -1)
        return Run([int(first[best])], 1)

    def _print(self, stretch: int) -> None:
        """Take a stretch: it is in nobody's way any more, and carries what lies on it."""
        self._todo[stretch] = False
        self.blocked += float(self._harm[stretch])
        self._harm -= self._blocked[stretch]
        own = slice(*np.searchsorted(self._stations.stretch, [stretch, stretch + 1]))
        if self._floating[stretch]:
            self._floats[own] |= ~self._held[own]
        rows = self._holding.carried[stretch]
        rows = rows[~self._held[rows]]
        self._held[rows] = True
        np.subtract.at(self._bare, self._stations.stretch[rows], 1.0)

    def floating_by_patch(self) -> dict[int, float]:
        """Area of each patch with nothing under it when it is printed [mm²]."""
        area: dict[int, float] = {}
        floating = np.bincount(
            self._stations.stretch, self._floats * self._stations.area, len(self._stretches)
        )
        for stretch, value in zip(self._stretches, floating):
            patch = self._passes[stretch.number].patch
            area[patch] = area.get(patch, 0.0) + float(value)
        return area


def _joined(
    passes: Sequence[Toolpath], stretches: Sequence[Stretch], runs: Sequence[Run]
) -> list[Toolpath]:
    """Make passes of the runs; those of a patch that end side by side become one."""
    done: list[Toolpath] = []
    for run in runs:
        low, high = stretches[min(run.stretches)], stretches[max(run.stretches)]
        path = passes[low.number]
        if not (low.first == 0 and high.last == len(path.points) - 1):
            path = _taken(path, low.first, high.last, run.way)
        link = None
        if done and done[-1].patch == path.patch and not (done[-1].closed or path.closed):
            link = _linked(done[-1], path)
        if link is None:
            done.append(path)
        else:
            done[-1] = link
    return done


def _taken(path: Toolpath, first: int, last: int, way: int) -> Toolpath:
    rows = np.arange(first, last + 1)[::way]
    return replace(
        path, points=path.points[rows], axes=path.axes[rows], width=path.width[rows],
        height=path.height[rows], closed=False,
    )  # fmt: skip


def _linked(one: Toolpath, other: Toolpath) -> Toolpath | None:
    """Join two passes that end and begin side by side; None where they do not.

    Each is shortened by half the step between them, so that the step lays what they lack.
    """
    gap = float(np.linalg.norm(other.points[0] - one.points[-1]))
    cosine = float(one.axes[-1] @ other.axes[0])
    far = gap > LINK_WIDTHS * float(one.width[-1])
    short = min(one.length_mm, other.length_mm) < 1.5 * gap
    if far or short or cosine < np.cos(np.radians(LINK_DEG)):
        return None
    ends = (_shortened(one, 0.5 * gap), _shortened(_turned(other), 0.5 * gap)[::-1])
    if gap < _SAME_MM:
        ends = (ends[0], ends[1][1:])
    rows = np.concatenate(ends)
    return replace(one, points=rows[:, :3], axes=rows[:, 3:6], width=rows[:, 6], height=rows[:, 7])


def _turned(path: Toolpath) -> Toolpath:
    return _taken(path, 0, len(path.points) - 1, -1)


def _shortened(path: Toolpath, by: float) -> Floats:
    """Rows of a pass (point, axis, width, height) without some length at its end, (n, 8)."""
    rows = np.column_stack([path.points, path.axes, path.width, path.height])
    along = arc_length(path.points)
    end = along[-1] - by
    kept = rows[along < end - _SAME_MM] if by > 0 else rows[:-1]
    last = np.array([np.interp(end, along, column) for column in rows.T])
    last[3:6] /= np.linalg.norm(last[3:6])
    return np.concatenate([kept, last[None]])
