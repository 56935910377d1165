# SPDX-License-Identifier: Apache-2.0
"""Joint paths of arms whose turn about the nozzle is free: six axes and more.

A printing nozzle is round, so that the sixth axis may turn as it likes. Along the path a
ladder of configurations is kept: a few families of the arm (elbow up, wrist flipped, ...),
each at even turns about the nozzle. Viterbi chooses the way along the ladder that moves
least and keeps away from joint limits and singularities; a smooth curve through its rungs
is then brought onto the path, pose by pose.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints
from vega_planner.errors import Unreachable
from vega_planner.robot import kernels as robot_kernels
from vega_planner.robot.chain import UNLIMITED
from vega_planner.robot.numeric import TOLERANCE
from vega_planner.robot.robot import Robot
from vega_planner.trajectory import branch_kernels, free_turn_kernels
from vega_planner.trajectory.branches import (
    TOUCH,
    Clear,
    jump_costs,
    require_reached,
    segment_name,
)
from vega_planner.trajectory.joint_path import lost
from vega_planner.trajectory.waypoints import Waypoints, evenly_cut, refined

#: Turns about the nozzle on the ladder.
RUNGS = 16
#: Families of the arm that are followed.
FAMILIES = 4
#: Poses of the ladder lie at most this far apart: along the path [m], and in turn [rad].
RUNG_SPACING = 5e-3
RUNG_TURN = 0.15
#: Iterations allowed from pose to pose.
_WARM = 25
#: Configurations of the first pose from which the families are picked.
_STARTS = 96
#: Weights [s per pose of the ladder] of being near a singularity and near a limit.
_SINGULAR_WEIGHT = 0.03
_LIMIT_WEIGHT = 0.01
#: A joint is near a limit within this share of its range.
_LIMIT_SHARE = 0.1
#: A step between rungs that takes longer than this is a change of configuration [s].
_LONGEST_STEP = 0.22
#: Weight [1/s] of the squared time of a step: rather many small steps than one large.
_STIFFNESS = 20.0


class FreeTurnPath:
    """Path solver for arms without a closed form; see `joint_path.PathSolver`."""

    def __init__(self, robot: Robot, clear: Clear | None = None):
        self.robot = robot
        self.clear = clear
        self.chain = robot.chain.arrays
        #: With five joints the turn is not free: the ladder has one rung per family.
        self.rungs = RUNGS if len(robot.joint_names) >= 6 else 1

    def choose(self, way: Waypoints) -> tuple[Waypoints, Floats, Ints]:
        """Choose family and turn of each pose; see `joint_path.PathSolver`."""
        way = refined(way, *evenly_cut(np.where(way.joined, _rungs_between(way), 1)))[0]
        sides = _sides(way.axes, self.robot.chain.T_base_plate[:3, :3])
        rows = _ladder_rows(way)
        ladder, found, measure = self._ladder(way, sides, rows)
        choice, turned = self._choose_rungs(way, rows, ladder, found, measure)
        return way, *self._solve_between(way, sides, rows, ladder, choice, turned)

    def follow(self, way: Waypoints, rows: Ints, guess: Floats, origin: Floats) -> Floats:
        """Solve poses from their own guesses; see `joint_path.PathSolver`."""
        q = np.zeros_like(guess)
        found = np.zeros(len(rows), np.bool_)
        robot_kernels.solve_each(
            self.chain,
            self.robot.lower,
            self.robot.upper,
            way.points[rows],
            way.axes[rows],
            guess,
            TOLERANCE,
            _WARM,
            q,
            found,
        )
        if not found.all():
            raise lost(way, int(rows[np.argmin(found)]))
        return q

    def _families(self, way: Waypoints, side: Floats) -> tuple[Floats, Bools]:
        """Rings of distinct configurations of the first pose, the best ones."""
        numeric = self.robot.numeric
        q, found = numeric.distinct(way.points[0], way.axes[0], _STARTS)
        q = q[found]
        rings: list[Floats] = []
        goods: list[Bools] = []
        scores: list[float] = []
        for start in q:
            ring = np.zeros((self.rungs, q.shape[1]))
            good = np.zeros(self.rungs, np.bool_)
            if self.rungs == 1:
                ring[0], good[0] = start, True
            else:
                angle = _turn_of(numeric.forward(start[None])[2][0], way.axes[0], side)
                free_turn_kernels.ring(
                    self.chain,
                    self.robot.lower,
                    self.robot.upper,
                    way.points[0],
                    way.axes[0],
                    side,
                    start,
                    angle,
                    TOLERANCE,
                    60,
                    ring,
                    good,
                )
            if not good.any() or any(_same_ring(ring, good, r, g) for r, g in zip(rings, goods)):
                continue
            rings.append(ring)
            goods.append(good)
            margin = self._limit_margin(ring[good]).mean()
            scores.append(good.mean() + margin)
            if self.clear is not None:
                scores[-1] += float(self.clear(ring[good]).mean())
        best = np.argsort(-np.array(scores), kind="stable")[:FAMILIES]
        return np.array([rings[k] for k in best]), np.array([goods[k] for k in best])

    def _ladder(self, way: Waypoints, sides: Floats, rows: Ints) -> tuple[Floats, Bools, Floats]:
        rings, goods = self._families(way, sides[0])
        shape = (len(rows), rings.shape[0] * rings.shape[1])
        q = np.zeros((*shape, rings.shape[2]))
        found = np.zeros(shape, np.bool_)
        measure = np.zeros(shape)
        free_turn_kernels.ladder(
            self.chain,
            self.robot.lower,
            self.robot.upper,
            way.points[rows],
            way.axes[rows],
            sides[rows] if self.rungs > 1 else np.zeros((len(rows), 0)),
            rings,
            goods,
            TOLERANCE,
            _WARM,
            q,
            found,
            measure,
        )
        return q, found, measure

    def _limit_margin(self, q: Floats) -> Floats:
        """Distance to the nearest joint limit as a share of the joint's range, (..., )."""
        limited = self.robot.upper < UNLIMITED
        lower, upper = self.robot.lower[limited], self.robot.upper[limited]
        q = q[..., limited]
        if not q.shape[-1]:
            return np.ones(q.shape[:-1])
        return np.asarray((np.minimum(q - lower, upper - q) / (upper - lower)).min(-1))

    def _choose_rungs(
        self, way: Waypoints, rows: Ints, q: Floats, found: Bools, measure: Floats
    ) -> tuple[Ints, Bools]:
        """Viterbi over the ladder; also tells where the configuration changes, (m - 1,)."""
        empty = rows[~found.any(1)]
        if len(empty):
            reached = np.ones(len(way.points), np.bool_)
            reached[empty] = self.robot.reachable(way.points[empty], way.axes[empty])
            require_reached(way, reached)
            at = int(empty[0])
            error = Unreachable(
                f"{segment_name(way, at)}: the arm cannot be led continuously to "
                f"{np.round(way.points[at] * 1000, 2).tolist()} mm in the base frame; move or "
                "turn the part"
            )
            error.waypoint = at
            raise error
        usual = float(np.quantile(measure[found], 0.9))
        cost = _SINGULAR_WEIGHT * usual / np.maximum(measure, 0.01 * usual)
        margin = np.maximum(self._limit_margin(q), 1e-3)
        cost += _LIMIT_WEIGHT * np.maximum(_LIMIT_SHARE / margin - 1.0, 0.0)
        if self.clear is not None:
            cost[found] += TOUCH * ~self.clear(q[found])
        # A change of configuration is cheapest where its interval holds the top of a travel.
        fine = jump_costs(way)
        jump = np.array([fine[a:b].min() for a, b in pairwise(rows)])
        endless = np.zeros(q.shape[2], np.bool_)
        allowed = np.full(len(rows) - 1, _LONGEST_STEP)
        choice = np.zeros(len(rows), np.int64)
        branch_kernels.cheapest_row(
            q, found, cost, self.robot.velocity, endless, allowed, jump, _STIFFNESS, choice
        )
        path = q[np.arange(len(rows)), choice]
        step = (np.abs(np.diff(path, axis=0)) / self.robot.velocity).max(1)
        return choice, step > _LONGEST_STEP

    def _solve_between(
        self,
        way: Waypoints,
        sides: Floats,
        rows: Ints,
        ladder: Floats,
        choice: Ints,
        changes: Bools,
    ) -> tuple[Floats, Ints]:
        """Solve every pose between the rungs, with the turn running smoothly."""
        q = np.zeros((len(way.points), ladder.shape[2]))
        fine = jump_costs(way)
        jumps = []
        bounds = [0, *(np.flatnonzero(changes) + 1).tolist(), len(rows)]
        edges = [0]
        for b in bounds[1:-1]:
            between = slice(int(rows[b - 1]), int(rows[b]))
            at = between.start + int(np.argmin(fine[between]))
            if way.printing[at]:
                raise _change_in_pass(way, at)
            jumps.append(at)
            edges.append(at + 1)
        edges.append(len(way.points))
        for k in range(len(bounds) - 1):
            rungs = np.arange(bounds[k], bounds[k + 1])
            part = np.arange(edges[k], edges[k + 1])
            chosen = ladder[rungs, choice[rungs]]
            q[part] = self._project(way, part, way.path[rows[rungs]], chosen)
        return q, np.array(jumps, dtype=np.int64)

    def _project(self, way: Waypoints, rows: Ints, at: Floats, chosen: Floats) -> Floats:
        """Run a smooth curve through rungs and bring each of its poses onto the path.

        The correction is the smallest one, so that it is as smooth as the curve.
        """
        found = np.zeros(len(rows), np.bool_)
        q = np.zeros((len(rows), chosen.shape[1]))
        for knots in (_smoothed(chosen), chosen):
            robot_kernels.solve_each(
                self.chain,
                self.robot.lower,
                self.robot.upper,
                way.points[rows],
                way.axes[rows],
                _curve(at, knots, way.path[rows]),
                TOLERANCE,
                _WARM,
                q,
                found,
            )
            if found.all():
                return q
        raise lost(way, int(rows[np.argmin(found)]))


def _rungs_between(way: Waypoints) -> Ints:
    """Number of steps of the ladder that each interval holds, at least 1."""
    return np.maximum(np.ceil(_ladder_steps(way)), 1).astype(np.int64)


def _ladder_steps(way: Waypoints) -> Floats:
    turn = np.linalg.norm(np.diff(way.axes, axis=0), axis=1)
    return np.asarray(np.maximum(np.diff(way.path) / RUNG_SPACING, turn / RUNG_TURN))


def _ladder_rows(way: Waypoints) -> Ints:
    """Pick poses of the ladder: ends of segments, and as many between as its spacing asks."""
    share = np.concatenate([[0.0], np.cumsum(_ladder_steps(way))])
    rungs = np.floor(share)
    picked = np.zeros(len(share), np.bool_)
    picked[1:] = np.diff(rungs) > 0
    picked[way.starts[:-1]] = True
    picked[-1] = True
    return np.flatnonzero(picked)


def _smoothed(knots: Floats) -> Floats:
    """Take the edge off the ladder's steps of turn."""
    for _ in range(2):
        if len(knots) > 2:
            inner = 0.25 * knots[:-2] + 0.5 * knots[1:-1] + 0.25 * knots[2:]
            knots = np.concatenate([knots[:1], inner, knots[-1:]])
    return knots


def _curve(at: Floats, knots: Floats, path: Floats) -> Floats:
    """Monotone cubic through knots at rising path parameters, shape (n, j)."""
    fresh = np.concatenate([[True], np.diff(at) > 1e-9])
    from scipy.interpolate import PchipInterpolator

    at, knots = at[fresh], knots[fresh]
    if len(at) < 2:
        return np.tile(knots[0], (len(path), 1))
    return np.asarray(PchipInterpolator(at, knots)(np.clip(path, at[0], at[-1])))


def _sides(axes: Floats, R_base_plate: Floats) -> Floats:
    """Zero of the turn: the plate's x axis after the least turn of its z onto each axis.

    Carried along a closed loop it comes back to itself, so that nothing winds up.
    """
    x, z = R_base_plate[:, 0], R_base_plate[:, 2]
    cosine = np.maximum(axes @ z, -1.0 + 1e-9)
    sides = x - ((axes @ x) / (1.0 + cosine))[:, None] * (axes + z)
    return np.asarray(sides / np.linalg.norm(sides, axis=1, keepdims=True))


def _turn_of(side: Floats, axis: Floats, zero: Floats) -> float:
    """Turn about the axis from the direction `zero` to `side`."""
    return float(np.arctan2(np.cross(zero, side) @ axis, zero @ side))


def _same_ring(a: Floats, a_good: Bools, b: Floats, b_good: Bools) -> bool:
    both = a_good & b_good
    return bool(both.any() and np.abs(a[both] - b[both]).max(1).min() < 0.3)


def _change_in_pass(way: Waypoints, at: int) -> Unreachable:
    error = Unreachable(
        f"{segment_name(way, at)} cannot be printed in one go: the arm would have to change its "
        f"configuration at {np.round(way.points[at] * 1000, 2).tolist()} mm in the base frame; "
        "move or turn the part"
    )
    error.waypoint = at
    return error
