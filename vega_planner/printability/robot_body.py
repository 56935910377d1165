# SPDX-License-Identifier: Apache-2.0
"""The robot's links against plate, substrate and print, at samples of the joint motion.

Every collision element of the URDF that moves is covered with points. At chosen moments
they are brought into the part frame and held against what is there. The nozzle and the
dispenser body are left to the check of every waypoint, which is exact.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np

from vega_planner.datatypes import (
    Bools,
    Floats,
    Ints,
    PrintabilityReport,
    PrintTrajectory,
    Reason,
    ToolpathSet,
)
from vega_planner.errors import BadRobot
from vega_planner.printability.material import mesh_field
from vega_planner.progress import Progress, Report
from vega_planner.robot.link_points import points_on
from vega_planner.units import m_to_mm, mm_to_m

if TYPE_CHECKING:
    from vega_planner.robot.robot import Robot
    from vega_planner.robot.workcell import Workcell

#: Samples of the motion between two that are looked at, and most that are.
EVERY, MOST = 50, 1500

#: What lies within the tool's profile, made larger by this, is the tool [mm].
TOOL_MM = 4.0

#: Less than this is no touch: links are drawn roughly [mm].
TOUCH_MM = 0.5

_REMEDY = "turn the part about z or move it (--pose), or tilt less (max_tilt_deg)"

#: Spacing of the grid that substrates are held in [mm].
GRID_MM = 1.0


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
    """

    hits: tuple[BodyHit, ...] = ()
    unread: tuple[str, ...] = ()


@dataclass(eq=False)
class _Body:
    """A link covered with points in its own frame [m]."""

    name: str
    frame: int
    points: Floats

    @cached_property
    def middle(self) -> Floats:
        """Middle of a ball around the points [m]."""
        return np.asarray(0.5 * (self.points.min(0) + self.points.max(0)))

    @cached_property
    def radius(self) -> float:
        """Its radius [m]."""
        return float(np.linalg.norm(self.points - self.middle, axis=1).max())


def check_robot_body(
    toolpaths: ToolpathSet, trajectory: PrintTrajectory, cell: Workcell, report: Report
) -> BodyCheck:
    """Hold the robot's links against plate, substrate and what is printed.

    Args:
        toolpaths: Passes and travel.
        trajectory: The joint motion along them.
        cell: Robot, tool, placement and substrate.
        report: Receives progress; may raise `Cancelled`.

    Returns:
        The links that touch something, and those that could not be looked at.
    """
    robot = cell.robot
    moments = _moments(trajectory)
    if not len(moments) or not toolpaths.passes:
        return BodyCheck()
    model = _Model(robot)
    unread: list[str] = []
    bodies = _bodies(model, cell, unread)
    touched = _Obstacles(toolpaths, cell, _plate_box(model, unread))
    # passes before the one that is being laid are there
    laid = np.maximum.accumulate(trajectory.path_id)
    found: dict[tuple[str, str], BodyHit] = {}
    T = trajectory.T_base_part
    for step, moment in enumerate(moments):
        if step % 100 == 0:
            report(Progress("checks", 0.5))
        frames = model.frames_at(trajectory.joint_names, trajectory.positions[moment])
        for body in bodies:
            R, p = frames(body.frame)
            middle = m_to_mm((R @ body.middle + p - T[:3, 3]) @ T[:3, :3])
            if middle[2] - m_to_mm(body.radius) > touched.top:
                continue
            points = m_to_mm((body.points @ R.T + p - T[:3, 3]) @ T[:3, :3])
            for obstacle, hit in touched.at(points, int(laid[moment])):
                key = (body.name, obstacle)
                if key in found:
                    found[key] = replace(found[key], count=found[key].count + 1)
                    continue
                x, y, z = (float(value) for value in points[int(np.argmax(hit))])
                time = float(trajectory.times[moment])
                found[key] = BodyHit(body.name, obstacle, time, (x, y, z), 1)
    return BodyCheck(tuple(found[key] for key in sorted(found)), tuple(unread))


def with_body(report: PrintabilityReport, check: BodyCheck) -> PrintabilityReport:
    """Take touching links into the report's reasons.

    The status stays: it tells of nozzle and dispenser. A link that touches is a matter of
    where the part stands and how far the nozzle tilts, and is told beside it.
    """
    reasons = tuple(
        Reason("robot_body", -1, 0.0, hit.where_mm, f"{told(hit)}: {_REMEDY}")
        for hit in check.hits
    )
    return replace(report, reasons=(*report.reasons, *reasons)) if reasons else report


def told(hit: BodyHit) -> str:
    """Say in one line which link touches what."""
    obstacle = hit.obstacle.replace("_", " ")
    x, y, z = hit.where_mm
    return (
        f"link '{hit.link}' meets the {obstacle} at ({x:.0f}, {y:.0f}, {z:.0f}) mm, first "
        f"{hit.time_s:.0f} s into the print, at {hit.count} of the moments looked at"
    )


def _moments(trajectory: PrintTrajectory) -> Ints:
    """Both ends of every pass, every so often a sample, the extremes of every joint."""
    count = len(trajectory.times)
    if not count:
        return np.zeros(0, np.int64)
    ends = np.flatnonzero(np.diff(trajectory.path_id))
    extremes = np.concatenate([trajectory.positions.argmin(0), trajectory.positions.argmax(0)])
    chosen = np.unique(np.concatenate([np.arange(0, count, EVERY), ends, ends + 1]))
    chosen = chosen[:: -(-len(chosen) // MOST)]
    return np.union1d(chosen, extremes)


class _Model:
    """pinocchio's model of all links, and where they are."""

    def __init__(self, robot: Robot) -> None:
        import pinocchio

        self._pinocchio = pinocchio
        self.urdf = ElementTree.fromstring(robot.urdf)
        self.model: Any = pinocchio.buildModelFromXML(robot.urdf)
        self._data = self.model.createData()
        self._neutral = pinocchio.neutral(self.model)

    def frames_at(
        self, names: tuple[str, ...], positions: Floats
    ) -> Callable[[int], tuple[Floats, Floats]]:
        """Place all links; the result gives rotation and origin [m] of a frame."""
        q = self._neutral.copy()
        for name, value in zip(names, positions, strict=True):
            joint = self.model.joints[self.model.getJointId(name)]
            if joint.nq == 2:
                q[joint.idx_q : joint.idx_q + 2] = np.cos(value), np.sin(value)
            else:
                q[joint.idx_q] = value
        self._pinocchio.framesForwardKinematics(self.model, self._data, q)

        def frame(index: int) -> tuple[Floats, Floats]:
            pose = self._data.oMf[index]
            return np.array(pose.rotation), np.array(pose.translation)

        return frame


def _covered(link: ElementTree.Element, unread: list[str]) -> Floats:
    """Cover a link with points [m], shape (n, 3); none, and a line, where it cannot be read."""
    try:
        parts = [points_on(element) for element in link.findall("collision")]
    except (BadRobot, ValueError) as error:
        unread.append(f"link '{link.get('name')}' is not checked: {error}")
        parts = []
    return np.concatenate([np.zeros((0, 3)), *parts])


def _bodies(model: _Model, cell: Workcell, unread: list[str]) -> list[_Body]:
    """Cover the links that move with points, but for the tool."""
    chain = cell.robot.chain
    frame = model.frames_at(chain.joint_names, np.clip(0.0, chain.lower, chain.upper))
    tip, axes = cell.robot.forward(
        np.clip(np.zeros((1, len(chain.lower))), chain.lower, chain.upper)
    )
    last = model.model.getJointId(chain.joint_names[-1])
    distance, radius = np.asarray(cell.tool.distance), np.asarray(cell.tool.radius)
    found = []
    for link in model.urdf.findall("link"):
        name = link.get("name", "")
        index = model.model.getFrameId(name)
        if index >= len(model.model.frames) or model.model.frames[index].parentJoint == 0:
            continue
        points = _covered(link, unread)
        if model.model.frames[index].parentJoint == last:
            R, p = frame(index)
            away = m_to_mm(points @ R.T + p - tip[0])
            s = away @ axes[0]
            r = np.linalg.norm(away - s[:, None] * axes[0], axis=1)
            points = points[r > np.interp(s, distance, radius) + TOOL_MM]
        if len(points):
            found.append(_Body(name, index, points))
    return found


class _Obstacles:
    """Plate, substrate and beads, in the part frame [mm]."""

    def __init__(
        self, toolpaths: ToolpathSet, cell: Workcell, plate: tuple[Floats, Floats] | None
    ) -> None:
        from scipy.spatial import cKDTree

        self._cell = cell
        self._field = None if cell.substrate is None else mesh_field(cell.substrate, GRID_MM)
        passes = toolpaths.passes
        points = np.concatenate([path.points for path in passes])
        self._number = np.concatenate([np.full(len(p.points), n) for n, p in enumerate(passes)])
        self._reach = 0.5 * max(float(path.height.max()) for path in passes)
        self._tree = cKDTree(points)
        self._low = points.min(0) - self._reach
        self._high = points.max(0) + self._reach
        self._plate = plate
        top = max(float(self._high[2]), cell.placement.plate_z_mm)
        if cell.substrate is not None:
            top = max(top, float(cell.substrate.vertices[:, 2].max()))
        #: Height above which there is nothing [mm].
        self.top = top

    def at(self, points: Floats, laid: int) -> list[tuple[str, Bools]]:
        """What some points touch while a pass is being laid."""
        found = []
        plate = self._on_plate(points)
        if plate.any():
            found.append(("plate", plate))
        if self._field is not None:
            deep = self._field.distance(points) < -TOUCH_MM
            if deep.any():
                found.append(("substrate", deep))
        near = np.flatnonzero(((points > self._low) & (points < self._high)).all(1))
        if len(near):
            bead = np.zeros(len(points), np.bool_)
            for k, close in zip(near, self._tree.query_ball_point(points[near], self._reach)):
                bead[k] = bool(len(close)) and bool((self._number[close] < laid).any())
            if bead.any():
                found.append(("printed_part", bead))
        return found

    def _on_plate(self, points: Floats) -> Bools:
        """Inside the plate, as large as the URDF draws it; as thick as drawn."""
        if self._plate is None:
            return np.zeros(len(points), np.bool_)
        T = self._cell.placement.T_base_part
        base = mm_to_m(points) @ T[:3, :3].T + T[:3, 3]
        P = self._cell.robot.chain.T_base_plate
        own = m_to_mm((base - P[:3, 3]) @ P[:3, :3])
        low, high = self._plate
        return np.asarray(((own > low + TOUCH_MM) & (own < high - TOUCH_MM)).all(1))


def _plate_box(model: _Model, unread: list[str]) -> tuple[Floats, Floats] | None:
    """Corners of the build plate in its own frame [mm], where the URDF draws one."""
    for link in model.urdf.findall("link"):
        if link.get("name") == "build_plate":
            points = m_to_mm(_covered(link, unread))
            return (points.min(0), points.max(0)) if len(points) else None
    return None
