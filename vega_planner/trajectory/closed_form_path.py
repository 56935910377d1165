# SPDX-License-Identifier: Apache-2.0
"""Joint paths of machines with a closed form: branch choice and the singular direction.

Where the nozzle comes near the direction of the first rotary axis, that axis would have to
turn at any rate to follow it exactly. Inside a small cone about this direction the first
angle is therefore blended, the second one brings the nozzle as near to its direction as it
can, and the linear axes keep the tip exactly on its path. There are two ways through the
cone: straight across, changing the branch, and round the axis, keeping it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints
from vega_planner.errors import VegaError
from vega_planner.robot import closed_form_kernels
from vega_planner.robot.closed_form import ClosedForm
from vega_planner.robot.robot import Robot
from vega_planner.trajectory import branch_kernels
from vega_planner.trajectory.branches import Clear, continuous_path, require_reached
from vega_planner.trajectory.joint_path import lost
from vega_planner.trajectory.waypoints import Waypoints, evenly_cut, refined

#: Half angles of the cone that are tried [deg].
CONES_DEG = (3.0, 2.0, 1.4, 0.9, 0.5)
#: Largest angle of the nozzle off its direction inside the cone [rad].
LARGEST_DEVIATION = np.radians(0.55)
#: The first axis may use this share of its speed inside the cone.
_RATE_SHARE = 0.9
#: Near the singular direction the axis turns by at most this from pose to pose [rad].
_NEAR_STEP = np.radians(0.12)
#: The first axis may turn by this across the cone: a quarter turn, for beyond it the other
#: branch is nearer, and some room [rad].
_ACROSS = 0.5 * np.pi + 0.3
#: And by this from the rim of the cone to the pose nearest to its middle [rad].
_HALF_ROUND = 0.5 * np.pi


@dataclass(frozen=True)
class Crossing:
    """One passage through the cone, between the poses that bound it.

    Attributes:
        enter: Index of the last pose before the cone, or of the first in it where the job
            begins there.
        leave: Index of the first pose behind it, or of the last in it.
        angles: First rotary angle at both [rad].
        slopes: Its derivative over the path parameter at both [rad/m].
        path: Path parameter at both [m].
    """

    enter: int
    leave: int
    angles: tuple[float, float]
    slopes: tuple[float, float]
    path: tuple[float, float]

    def angle_at(self, path: Floats) -> Floats:
        """First rotary angle at path parameters between the ends: a cubic."""
        length = max(self.path[1] - self.path[0], 1e-12)
        w = np.clip((path - self.path[0]) / length, 0.0, 1.0)
        a, b = self.angles
        m, n = self.slopes[0] * length, self.slopes[1] * length
        return a + w * (m + w * (3 * (b - a) - 2 * m - n + w * (2 * (a - b) + m + n)))


class ClosedFormPath:
    """Both branches in closed form, and the nearest one where poses are added.

    Args:
        robot: A robot with a closed form.
        speed: Printing speed [m/s].
        clear: Tells which configurations to prefer; see `branches.Clear`.
    """

    def __init__(self, robot: Robot, speed: float, clear: Clear | None = None):
        if robot.closed_form is None:
            raise VegaError(f"robot '{robot.name}' has no closed form")
        self.robot = robot
        self.clear = clear
        self.form: ClosedForm = robot.closed_form
        #: Turn per length [rad/m] at which the first axis keeps up with the printing speed.
        self.rate = _RATE_SHARE * float(robot.velocity[3]) / speed
        self.crossings: list[Crossing] = []

    def choose(self, way: Waypoints) -> tuple[Waypoints, Floats, Ints]:
        """Choose the branch of each pose; see `joint_path.PathSolver`."""
        way = self._finer_near_the_singularity(way)
        sine = self._off_singular(way)
        solutions = self.robot.solve(way.points, way.axes)
        if not (sine < np.sin(np.radians(CONES_DEG[0]))).any():
            q, jumps = continuous_path(way, solutions, self.robot, clear=self.clear)
            return way, q, jumps
        require_reached(way, np.asarray(solutions.valid.any(1)))
        return self._choose_across(way, sine)

    def follow(self, way: Waypoints, rows: Ints, guess: Floats, origin: Floats) -> Floats:
        """Take the branch nearest to the guess; see `joint_path.PathSolver`."""
        solutions = self.robot.solve(way.points[rows], way.axes[rows])
        q = np.zeros_like(guess)
        inside = np.zeros(len(rows), np.bool_)
        for crossing in self.crossings:
            here = (origin > crossing.enter) & (origin < crossing.leave)
            inside |= here
            # between two poses of the cone the blend is all but straight
            q[here] = self._blended(way.points[rows[here]], way.axes[rows[here]], guess[here, 3])
        near = ~inside
        part = np.zeros((int(near.sum()), guess.shape[1]))
        missing = branch_kernels.nearest_candidate(
            solutions.candidates[near],
            solutions.valid[near],
            guess[near],
            self.robot.chain.revolute,
            self.robot.lower,
            self.robot.upper,
            part,
        )
        if missing >= 0:
            raise lost(way, int(rows[near][missing]))
        q[near] = part
        return q

    def _off_singular(self, way: Waypoints) -> Floats:
        """Sine of the angle between nozzle and first rotary axis, shape (n,)."""
        return np.asarray(np.linalg.norm(np.cross(way.axes, self.form.geometry[1]), axis=1))

    def _finer_near_the_singularity(self, way: Waypoints) -> Waypoints:
        sine = self._off_singular(way)
        turn = np.linalg.norm(np.diff(way.axes, axis=0), axis=1)
        widest = 1.5 * np.sin(np.radians(CONES_DEG[0]))
        near = way.joined & (np.minimum(sine[:-1], sine[1:]) - turn < widest)
        pieces = np.where(near, np.ceil(turn / _NEAR_STEP), 1).astype(np.int64)
        return refined(way, *evenly_cut(pieces))[0] if pieces.max() > 1 else way

    def _choose_across(self, way: Waypoints, sine: Floats) -> tuple[Waypoints, Floats, Ints]:
        """Branch choice that leaves out the poses in the cone, and blends through them."""
        inside = np.zeros(len(sine), np.bool_)
        for start, stop in _runs(sine < np.sin(np.radians(CONES_DEG[0]))):
            inside[start:stop] = self._best_mask(way, sine, start, stop)
        q, jumps, self.crossings = self._solve_outside(way, inside, self.clear)
        axes = way.axes.copy()
        axes[inside] = self.robot.forward(q[inside])[1]
        return Waypoints(way.points, axes, way.path, way.starts, way.path_id), q, jumps

    def _best_mask(self, way: Waypoints, sine: Floats, start: int, stop: int) -> Bools:
        """Choose which poses of one passage to blend over: exact where speed allows.

        Of the ways through that keep the nozzle near its direction, the one on which the
        first axis turns slowest.
        """
        lo, hi = max(start - 3, 0), min(stop + 3, len(sine))
        part = Waypoints(
            way.points[lo:hi],
            way.axes[lo:hi],
            way.path[lo:hi],
            np.array([0, hi - lo]),
            np.array([-1]),
        )
        near = sine[lo:hi]
        best = np.zeros(hi - lo, np.bool_)
        least = np.inf
        for cone in (0.0, *CONES_DEG):
            across = near < np.sin(np.radians(cone))
            around = across.copy()
            around[np.argmin(near)] = False  # passes the closest pose exactly
            for mask in (across, around):
                rate = self._rate(part, mask)
                if rate < 0.99 * least:
                    least, best = rate, mask
            if least <= self.rate:
                break
        return best[start - lo : stop - lo]

    def _rate(self, part: Waypoints, mask: Bools) -> float:
        """Largest turn per length [rad/m] of the first axis; infinite if the nozzle strays."""
        if mask.all():
            return np.inf
        q, _, _ = self._solve_outside(part, mask)
        if mask.any():
            off = np.linalg.norm(self.robot.forward(q[mask])[1] - part.axes[mask], axis=1)
            if off.max() > LARGEST_DEVIATION:
                return np.inf
        length = np.diff(part.path)
        moved = length > 1e-12
        return float(np.max(np.abs(np.diff(q[:, 3])[moved]) / length[moved], initial=0.0))

    def _solve_outside(
        self, way: Waypoints, inside: Bools, clear: Clear | None = None
    ) -> tuple[Floats, Ints, list[Crossing]]:
        """Viterbi over the poses outside the cone, then the blend for those inside."""
        solutions = self.robot.solve(way.points, way.axes)
        outside = np.flatnonzero(~inside)
        gap = np.concatenate([[False], np.diff(outside) > 1, [False]])
        # A pose between two runs belongs to a way round the axis: a change of branch there
        # takes more than a quarter turn, and is a jump.
        halfway = gap[:-1] & gap[1:]
        room = np.where(halfway[:-1] | halfway[1:], _HALF_ROUND, _ACROSS)
        q = np.zeros((len(inside), 5))
        q[outside], jumps = continuous_path(
            way,
            solutions,
            self.robot,
            clear=clear,
            rows=outside,
            room=np.where(gap[1:-1], room, 0.0),
        )
        jumps = outside[jumps]
        crossings = []
        for start, stop in _runs(inside):
            crossing = _crossing(way, q, inside, start, stop)
            crossings.append(crossing)
            rows = np.arange(start, stop)
            q[rows] = self._blended(
                way.points[rows], way.axes[rows], crossing.angle_at(way.path[rows])
            )
        return q, jumps, crossings

    def _blended(self, points: Floats, axes: Floats, first: Floats) -> Floats:
        """Joint positions with a given first rotary angle: tip exact, axis as near as can be."""
        q = np.zeros((len(points), 5))
        trig = np.zeros(4)
        for i in range(len(points)):
            second = closed_form_kernels.nearest_second_angle(
                self.form.geometry, axes[i], first[i], trig
            )
            closed_form_kernels.linear_axes(
                self.form.geometry, points[i], trig[0], trig[1], trig[2], trig[3], q[i]
            )
            q[i, 3] = first[i]
            q[i, 4] = closed_form_kernels.into_limits(
                second, self.robot.lower[4], self.robot.upper[4]
            )
        return q


def _runs(mask: Bools) -> list[tuple[int, int]]:
    """Start and stop of each run of True."""
    edges = np.diff(np.concatenate([[0], mask.astype(np.int8), [0]]))
    return list(zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True))


def _crossing(way: Waypoints, q: Floats, inside: Bools, start: int, stop: int) -> Crossing:
    """The blend between the poses around a run in the cone, with the slopes they have."""

    def slope(pose: int, aside: int) -> float:
        """Slope at a pose outside, from its neighbour; between two runs, over both."""
        a, b = sorted((pose, aside))
        if 0 <= aside < len(q) and inside[aside]:
            outer = np.flatnonzero(~inside)
            at = int(np.searchsorted(outer, pose))
            a, b = int(outer[max(at - 1, 0)]), int(outer[min(at + 1, len(outer) - 1)])
        if a < 0 or b >= len(q) or way.path[b] - way.path[a] < 1e-9:
            return 0.0
        return float((q[b, 3] - q[a, 3]) / (way.path[b] - way.path[a]))

    last = len(q) - 1
    if start == 0 or stop > last:  # the job begins or ends in the cone: hold still
        known = stop if start == 0 else start - 1
        angle = float(q[known, 3])
        ends = (max(start - 1, 0), min(stop, last))
        path = (float(way.path[ends[0]]), float(way.path[ends[1]]))
        return Crossing(*ends, (angle, angle), (0.0, 0.0), path)
    enter, leave = start - 1, stop
    return Crossing(
        enter,
        leave,
        (float(q[enter, 3]), float(q[leave, 3])),
        (slope(enter, enter - 1), slope(leave, leave + 1)),
        (float(way.path[enter]), float(way.path[leave])),
    )
