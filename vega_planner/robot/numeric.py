# SPDX-License-Identifier: Apache-2.0
"""Numeric inverse kinematics of any serial chain: Levenberg-Marquardt from good seeds.

A table of random configurations is kept with the poses they reach. A target starts from
the neighbouring target's solution and then from the table's configurations that come
nearest to it, which finds far more than random restarts do.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from vega_planner.datatypes import Bools, Floats, Ints
from vega_planner.parallel import map_threads
from vega_planner.robot import kernels
from vega_planner.robot.chain import UNLIMITED, Chain

#: Residual [rad, and 0.1 m] at which a target counts as met: 0.1 nm and 1e-9 rad.
TOLERANCE = 1e-9
#: Iterations from one seed; what converges does so in 5 to 20.
ITERATIONS = 60
#: Rounds before the full one: first seed and end, and iterations from each. What has not
#: converged by then seldom will, and the next seed mostly does.
ROUNDS = ((0, 1, 14), (1, 4, 16), (4, 12, 30))
#: Seeds tried per target in the full round, and size of the table they come from.
SEEDS = 12
TABLE = 20_000
#: Targets given to a thread at a time.
_CHUNK = 4096


class Numeric:
    """Solver for any chain of five or more joints."""

    def __init__(self, chain: Chain):
        self.chain = chain
        rng = np.random.default_rng(20_230)
        lower = np.where(chain.lower <= -UNLIMITED, -np.pi, chain.lower)
        upper = np.where(chain.upper >= UNLIMITED, np.pi, chain.upper)
        self._table = lower + (upper - lower) * rng.random((TABLE, len(lower)))
        points, axes, _ = self.forward(self._table)
        self._tree = cKDTree(np.hstack([points / kernels.LENGTH, axes]))
        low, high = points.min(0), points.max(0)
        #: Box around everything reachable, with room for what the table missed.
        self._box = low - 0.1 * (high - low) - 0.05, high + 0.1 * (high - low) + 0.05

    def forward(self, q: Floats) -> tuple[Floats, Floats, Floats]:
        """Tip positions, nozzle axes and tip x axes of configurations (n, j), each (n, 3)."""
        points, axes, sides = (np.zeros((len(q), 3)) for _ in range(3))
        kernels.forward_many(
            self.chain.arrays, np.ascontiguousarray(q, np.float64), points, axes, sides
        )
        return points, axes, sides

    def solve(self, points: Floats, axes: Floats, seeds: int = SEEDS) -> tuple[Floats, Bools]:
        """Find one configuration of each target.

        Args:
            points: Tip positions [m], shape (n, 3).
            axes: Unit nozzle axes, shape (n, 3).
            seeds: Configurations tried per target.

        Returns:
            Configurations (n, j), and whether each meets its target within the limits.
        """
        n = len(points)
        points = np.ascontiguousarray(points, np.float64)
        axes = np.ascontiguousarray(axes, np.float64)
        q = np.zeros((n, len(self.chain.lower)))
        found = np.zeros(n, np.bool_)
        near = ((points > self._box[0]) & (points < self._box[1])).all(1)
        # most targets need one seed only; the search for many is kept for the others
        for first, last, limit in (*ROUNDS, (0, seeds, ITERATIONS)):
            todo = np.flatnonzero(near & ~found)
            ranks = list(range(first + 1, last + 1))

            def work(
                piece: slice, ranks: list[int] = ranks, limit: int = limit, todo: Ints = todo
            ) -> None:
                rows = todo[piece]
                poses = np.hstack([points[rows] / kernels.LENGTH, axes[rows]])
                _, index = self._tree.query(poses, k=ranks)
                q[rows], found[rows] = self._run(points[rows], axes[rows], index, limit)

            map_threads(work, [slice(i, i + _CHUNK) for i in range(0, len(todo), _CHUNK)])
        return q, found

    def distinct(self, point: Floats, axis: Floats, count: int) -> tuple[Floats, Bools]:
        """Solve one target from many seeds.

        Args:
            point: Tip position [m], shape (3,).
            axis: Unit nozzle axis, shape (3,).
            count: Number of seeds.

        Returns:
            Configurations (count, j), many of them alike, and whether each meets the target.
        """
        _, index = self._tree.query(np.concatenate([point / kernels.LENGTH, axis]), k=count)
        q = np.zeros((count, len(self.chain.lower)))
        found = np.zeros(count, np.bool_)
        kernels.solve_each(
            self.chain.arrays,
            self.chain.lower,
            self.chain.upper,
            np.tile(point, (count, 1)),
            np.tile(axis, (count, 1)),
            self._table[index],
            TOLERANCE,
            ITERATIONS,
            q,
            found,
        )
        return q, found

    def point_reached(self, points: Floats) -> Bools:
        """Tell which points the tip reaches with any axis at all.

        Args:
            points: Tip positions [m], shape (n, 3).
        """
        tree = cKDTree(self._tree.data[:, :3])
        _, index = tree.query(points / kernels.LENGTH, k=4)
        return self._run(np.ascontiguousarray(points), np.zeros((0, 3)), index, ITERATIONS)[1]

    def _run(self, points: Floats, axes: Floats, index: Ints, limit: int) -> tuple[Floats, Bools]:
        q = np.zeros((len(points), len(self.chain.lower)))
        found = np.zeros(len(points), np.bool_)
        kernels.solve_seeded(
            self.chain.arrays,
            self.chain.lower,
            self.chain.upper,
            points,
            axes,
            self._table[index.reshape(len(points), -1)],
            TOLERANCE,
            limit,
            q,
            found,
        )
        return q, found
