# SPDX-License-Identifier: Apache-2.0
"""From tip poses to one continuous joint path whose chords stay on the tip's path."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints
from vega_planner.errors import Unreachable
from vega_planner.parallel import map_threads
from vega_planner.robot.robot import Robot
from vega_planner.trajectory import joint_path_kernels as kernels
from vega_planner.trajectory import topp_ra_kernels
from vega_planner.trajectory.waypoints import Waypoints, evenly_cut, refined

#: Largest step of a rotary joint between two samples [rad].
LARGEST_STEP = 0.15
#: Largest angle of the nozzle off its axis between two samples [rad].
AXIS_TOLERANCE = np.radians(0.1)
#: Intervals given to a thread at a time.
_CHUNK = 8192
#: Rounds of refinement; each divides the error by the square of the number of pieces.
_ROUNDS = 5
#: An interval is cut into at most this many pieces per round.
_MOST_PIECES = 64
#: Share of the speed limits at which the arm changes its configuration.
_RECONFIGURE_SPEED = 0.5


@dataclass(frozen=True, eq=False)
class JointPath:
    """Joint positions along the waypoints of a job.

    Attributes:
        way: The tip poses; on changes of configuration, those the arm happens to have.
        q: Joint positions [m, rad], shape (n, j).
        reconfigures: True for the segments that change the configuration, shape (m,).
    """

    way: Waypoints
    q: Floats
    reconfigures: Bools


class PathSolver(Protocol):
    """Inverse kinematics along a path: the choice first, then the poses in between."""

    def choose(self, way: Waypoints) -> tuple[Waypoints, Floats, Ints]:
        """Choose a configuration for each pose.

        Returns:
            The poses, with more of them where the solver needs it and with the axes the
            nozzle really has, joint positions (n, j), and the intervals at which the arm
            has to jump.
        """
        ...

    def follow(self, way: Waypoints, rows: Ints, guess: Floats, origin: Floats) -> Floats:
        """Solve new poses `rows` (k,) near a guess (k, j); origin (k,) is as of `refined`.

        Raises:
            Unreachable: If a pose has no configuration near its guess.
        """
        ...


def joint_path(way: Waypoints, robot: Robot, solver: PathSolver, tolerance: float) -> JointPath:
    """Solve a job's poses and refine them until straight joint moves keep the tip on its path.

    Args:
        way: The poses.
        robot: The robot.
        solver: Its inverse kinematics.
        tolerance: Largest distance of the tip from the chord between two poses [m].

    Raises:
        Unreachable: If no continuous joint path exists.
    """
    way, q, jumps = solver.choose(way)
    fixed = np.zeros(len(way.points), np.bool_)
    reconfigures = np.zeros(len(way.path_id), np.bool_)
    origin = np.arange(len(q), dtype=np.float64)
    if len(jumps):
        way, q, reconfigures, origin = _with_reconfigurations(way, q, jumps, robot)
    look = np.ones(len(way.points) - 1, np.bool_)
    for _ in range(_ROUNDS):
        fixed = reconfigures[way.segment]
        pieces = _pieces(way, q, look & way.joined & ~fixed[:-1], robot, tolerance)
        if pieces.max() == 1:
            break
        way, place = refined(way, *evenly_cut(pieces))
        base = np.floor(place).astype(np.int64)
        part = place - base
        after = np.minimum(base + 1, len(q) - 1)
        guess = (1.0 - part[:, None]) * q[base] + part[:, None] * q[after]
        origin = (1.0 - part) * origin[base] + part * origin[after]
        new = np.flatnonzero(part > 0)
        guess[new] = solver.follow(way, new, guess[new], origin[new])
        q = guess
        # new intervals and, for their slopes changed, the ones beside them
        fresh = part > 0
        look = fresh[:-1] | fresh[1:]
        look[1:] |= fresh[:-2]
        look[:-1] |= fresh[2:]
    return JointPath(way, q, reconfigures)


def _pieces(way: Waypoints, q: Floats, look: Bools, robot: Robot, tolerance: float) -> Ints:
    """Number of equal pieces each interval to look at has to be cut into, shape (n - 1,)."""
    rows = np.flatnonzero(look)
    slope = _slopes(way, q)
    off, tilt = np.zeros(len(rows)), np.zeros(len(rows))

    def work(part: slice) -> None:
        kernels.gaps_between(
            robot.chain.arrays,
            way.points,
            way.axes,
            way.path,
            q,
            slope,
            rows[part],
            off[part],
            tilt[part],
        )

    map_threads(work, [slice(k, k + _CHUNK) for k in range(0, len(rows), _CHUNK)])
    step = np.abs(q[rows + 1] - q[rows])[:, robot.chain.revolute].max(1)
    # The sagitta falls with the square of the number of pieces.
    wanted = np.ceil(np.sqrt(np.maximum(off / tolerance, tilt / AXIS_TOLERANCE)))
    wanted = np.maximum(wanted, np.ceil(step / LARGEST_STEP))
    pieces = np.ones(len(look), np.int64)
    pieces[rows] = np.clip(wanted, 1, _MOST_PIECES)
    return pieces


def _slopes(way: Waypoints, q: Floats) -> Floats:
    """Derivatives of the joints over the path, as the time law will take them."""
    slope, curvature = np.zeros_like(q), np.zeros_like(q)
    for start, end in pairwise(way.starts.tolist()):
        topp_ra_kernels.path_slopes(
            way.path[start:end], q[start:end], slope[start:end], curvature[start:end]
        )
    return slope


def _with_reconfigurations(
    way: Waypoints, q: Floats, jumps: Ints, robot: Robot
) -> tuple[Waypoints, Floats, Bools, Floats]:
    """Turn jumps into segments of their own in which the joints move straight."""
    points, axes, path, rows, ids, changes, origin = [], [], [], [], [], [], []
    offset = 0.0

    def add(
        path_id: int, change: bool, p: Floats, u: Floats, s: Floats, r: Floats, o: Floats
    ) -> None:
        points.append(p)
        axes.append(u)
        path.append(s + offset)
        rows.append(r)
        ids.append(path_id)
        changes.append(change)
        origin.append(o)

    for k, path_id in enumerate(way.path_id):
        start, end = int(way.starts[k]), int(way.starts[k + 1])
        for at in [int(i) for i in jumps if start <= i < end - 1]:
            if at > start:
                part = slice(start, at + 1)
                add(
                    path_id,
                    False,
                    way.points[part],
                    way.axes[part],
                    way.path[part],
                    q[part],
                    np.arange(start, at + 1.0),
                )
            change = np.abs(q[at + 1] - q[at])
            time = float((change / robot.velocity).max()) / _RECONFIGURE_SPEED
            count = max(int(np.ceil(change[robot.chain.revolute].max() / 0.05)), 8)
            # close poses at both ends, where the joints speed up and come to rest
            w = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, count + 1))
            joints = (1.0 - w[:, None]) * q[at] + w[:, None] * q[at + 1]
            tip, nozzle = robot.forward(joints)
            add(path_id, True, tip, nozzle, way.path[at] + time * w, joints, at + w)
            offset += time - (way.path[at + 1] - way.path[at])
            start = at + 1
        if end - start > 1:
            part = slice(start, end)
            add(
                path_id,
                False,
                way.points[part],
                way.axes[part],
                way.path[part],
                q[part],
                np.arange(start, float(end)),
            )
    starts = np.concatenate([[0], np.cumsum([len(piece) for piece in points])])
    new = Waypoints(
        np.concatenate(points),
        np.concatenate(axes),
        np.concatenate(path),
        starts,
        np.array(ids),
    )
    return new, np.concatenate(rows), np.array(changes), np.concatenate(origin)


def lost(way: Waypoints, row: int) -> Unreachable:
    """The error for a pose between two reachable ones that is not reached itself."""
    from vega_planner.trajectory.branches import segment_name

    error = Unreachable(
        f"{segment_name(way, row)} leaves the robot's reach between two reachable poses, at "
        f"{np.round(way.points[row] * 1000, 2).tolist()} mm in the base frame; move the part"
    )
    error.waypoint = row
    return error
