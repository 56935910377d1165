# SPDX-License-Identifier: Apache-2.0
"""Closed-form inverse kinematics of machines with three linear axes and a two-axis wrist.

Applies to any three independent linear axes followed by any two rotary axes that are not
parallel; they need neither cut each other nor stand square.

Source: B. Paden, "Kinematics and Control of Robot Manipulators", PhD thesis, Berkeley 1986
(subproblem 2), here on directions; the linear axes take the rest.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from vega_planner.datatypes import Bools, Floats
from vega_planner.parallel import map_threads
from vega_planner.robot import closed_form_kernels as kernels
from vega_planner.robot.chain import Chain

#: Smallest determinant of the linear axes, and sine between the rotary ones, that counts
#: as independent.
_INDEPENDENT = 1e-3
#: Targets given to a thread at a time; below it threads cost more than they bring.
_CHUNK = 8192


class ClosedForm:
    """Solver for the kind of chain that `applies` recognises."""

    def __init__(self, chain: Chain):
        rotation, position = np.eye(3), np.zeros(3)
        axes, points = [], []
        for i in range(5):
            position = position + rotation @ chain.offsets[i]
            rotation = rotation @ chain.rotations[i]
            axes.append(rotation @ chain.axes[i])
            points.append(position)
        tip = position + rotation @ chain.tip
        #: inverse of the linear axes, both rotary axes, centre 2 to tip, centre 1 to centre 2,
        #: centre 1, nozzle axis; all with the joints at 0.
        self.geometry: tuple[Any, ...] = (
            np.ascontiguousarray(np.linalg.inv(np.array(axes[:3]).T)),
            axes[3],
            axes[4],
            tip - points[4],
            points[4] - points[3],
            points[3],
            rotation @ chain.tip_axes[0],
        )
        self.lower, self.upper = chain.lower, chain.upper

    @staticmethod
    def applies(chain: Chain) -> bool:
        """Tell whether a chain is three linear and two rotary axes in general position."""
        if chain.revolute.tolist() != [False, False, False, True, True]:
            return False
        rotation = np.eye(3)
        axes = []
        for i in range(5):
            rotation = rotation @ chain.rotations[i]
            axes.append(rotation @ chain.axes[i])
        spread = np.linalg.norm(np.cross(axes[3], axes[4]))
        return bool(
            abs(np.linalg.det(np.array(axes[:3]))) > _INDEPENDENT and spread > _INDEPENDENT
        )

    def solve(
        self, points: Floats, axes: Floats, *, first_only: bool = False
    ) -> tuple[Floats, Bools, Bools]:
        """Find both branches of each target.

        Args:
            points: Tip positions [m], shape (n, 3).
            axes: Unit nozzle axes, shape (n, 3).
            first_only: Leave out the second branch where the first one is valid.

        Returns:
            Candidates (n, 2, 5), whether they keep all limits (n, 2), and whether they keep
            the rotary limits (n, 2).
        """
        q, valid, wrist = kernels.empty_solutions(len(points))
        points = np.ascontiguousarray(points, np.float64)
        axes = np.ascontiguousarray(axes, np.float64)

        def work(rows: slice) -> None:
            kernels.solve_many(
                self.geometry,
                self.lower,
                self.upper,
                points[rows],
                axes[rows],
                first_only,
                q[rows],
                valid[rows],
                wrist[rows],
            )

        map_threads(work, [slice(i, i + _CHUNK) for i in range(0, len(points), _CHUNK)])
        return q, valid, wrist
