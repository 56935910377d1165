# SPDX-License-Identifier: Apache-2.0
"""The robot's links against plate, substrate and print, at every sample of the joint motion."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from vega_planner.datatypes import PrintabilityReport, PrintTrajectory, Reason, ToolpathSet
from vega_planner.printability.links import OBSTACLES, LinkWatch
from vega_planner.progress import Progress, Report
from vega_planner.trajectory.waypoints import passes_there

if TYPE_CHECKING:
    from vega_planner.robot.workcell import Workcell

#: Samples looked at between two reports of progress.
AT_ONCE = 16_384

_REMEDY = "turn the part about z or move it (--pose), or tilt less (max_tilt_deg)"


@dataclass(frozen=True)
class BodyHit:
    """A link that touches something.

    Attributes:
        link: Name of the link.
        obstacle: "plate", "substrate" or "printed_part".
        time_s: When it happens first.
        where_mm: Where, part frame.
        count: Samples of the motion at which it happens.
    """

    link: str
    obstacle: str
    time_s: float
    where_mm: tuple[float, float, float]
    count: int


@dataclass(frozen=True)
class BodyCheck:
    """Outcome of the check of the links.

    Attributes:
        hits: Links that touch something, by name.
        unread: Why links are checked in part or not at all, a line each.
        checked: Samples of the motion that were looked at.
        touching: Samples at which any link touches anything.
    """

    hits: tuple[BodyHit, ...] = ()
    unread: tuple[str, ...] = ()
    checked: int = 0
    touching: int = 0

    def summary(self) -> dict[str, Any]:
        """Tell the outcome in plain values, as `summary.json` and the certificate hold it."""
        return {
            "checked_samples": self.checked,
            "touching_samples": self.touching,
            "touching_links": [f"{hit.link}: {hit.obstacle}" for hit in self.hits],
        }


def check_robot_body(
    toolpaths: ToolpathSet,
    trajectory: PrintTrajectory,
    cell: Workcell,
    report: Report,
    watch: LinkWatch | None = None,
) -> BodyCheck:
    """Hold the robot's links against plate, substrate and what is printed.

    Args:
        toolpaths: Passes and travel.
        trajectory: The joint motion along them.
        cell: Robot, tool, placement and substrate.
        report: Receives progress; may raise `Cancelled`.
        watch: The links and what is there, where they are known already.

    Returns:
        The links that touch something, and those that could not be looked at.
    """
    if not len(trajectory.times) or not toolpaths.passes:
        return BodyCheck()
    watch = watch or LinkWatch(toolpaths, cell)
    now = passes_there(trajectory.path_id)
    found = []
    for begin in range(0, len(now), AT_ONCE):
        rows = slice(begin, begin + AT_ONCE)
        found.append(watch.touching(trajectory.positions[rows], now[rows]))
        report(Progress("checks", 0.5))
    touched = np.concatenate(found)
    hits = []
    for link, name in enumerate(watch.links.names):
        for bit, obstacle in OBSTACLES.items():
            at = np.flatnonzero(touched[:, link] & bit)
            if len(at):
                first = int(at[0])
                x, y, z = watch.place(trajectory.positions[first], int(now[first]), link, bit)
                where = (float(x), float(y), float(z))
                time = float(trajectory.times[first])
                hits.append(BodyHit(name, obstacle, time, where, len(at)))
    hits.sort(key=lambda hit: (hit.link, hit.obstacle))
    return BodyCheck(tuple(hits), watch.links.unread, len(now), int(touched.any(1).sum()))


def with_body(report: PrintabilityReport, check: BodyCheck) -> PrintabilityReport:
    """Take touching links into the report's reasons.

    A link that touches counts like a nozzle that collides: the part cannot be printed so.
    """
    reasons = tuple(
        Reason("robot_body", -1, 0.0, hit.where_mm, f"{told(hit)}: {_REMEDY}")
        for hit in check.hits
    )
    if not reasons:
        return report
    return replace(report, status="not", reasons=(*report.reasons, *reasons))


def told(hit: BodyHit) -> str:
    """Say in one line which link touches what."""
    obstacle = hit.obstacle.replace("_", " ")
    x, y, z = hit.where_mm
    return (
        f"link '{hit.link}' meets the {obstacle} at ({x:.0f}, {y:.0f}, {z:.0f}) mm, first "
        f"{hit.time_s:.0f} s into the print, at {hit.count} samples of the motion"
    )
