# SPDX-License-Identifier: Apache-2.0
"""A robot: forward and inverse kinematics and the limits of its joints. SI units."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints
from vega_planner.robot import kernels
from vega_planner.robot.chain import Chain, read_chain
from vega_planner.robot.closed_form import ClosedForm
from vega_planner.robot.description import load_description

if TYPE_CHECKING:
    from vega_planner.robot.numeric import Numeric

#: Values of `Robot.reach_reason`.
REACHED, OUT_OF_TRAVEL, WRIST_LIMIT = 0, 1, 2


@dataclass(frozen=True, eq=False)
class IKSolutions:
    """Joint configurations that bring the tip to targets.

    Attributes:
        candidates: Joint positions [m, rad], shape (n, k, j); rotary joints are given in
            the turn nearest to the middle of their limits.
        valid: True where a candidate exists and keeps the limits, shape (n, k).
    """

    candidates: Floats
    valid: Bools


@dataclass(frozen=True, eq=False)
class Robot:
    """A serial robot of five or more joints, read from a URDF.

    Attributes:
        name: Name of the robot.
        urdf: URDF text with plate and tip links in it.
        chain: The joints between base and tip.
    """

    name: str
    urdf: str
    chain: Chain

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints from base to tip, as in the URDF."""
        return self.chain.joint_names

    @property
    def lower(self) -> Floats:
        """Lowest joint positions [m, rad], shape (j,)."""
        return self.chain.lower

    @property
    def upper(self) -> Floats:
        """Highest joint positions [m, rad], shape (j,)."""
        return self.chain.upper

    @property
    def velocity(self) -> Floats:
        """Largest joint velocities [m/s, rad/s], shape (j,)."""
        return self.chain.velocity

    @property
    def acceleration(self) -> Floats:
        """Largest joint accelerations [m/s², rad/s²], shape (j,)."""
        return self.chain.acceleration

    @cached_property
    def closed_form(self) -> ClosedForm | None:
        """The closed-form solver, where the chain has one."""
        return ClosedForm(self.chain) if ClosedForm.applies(self.chain) else None

    @cached_property
    def numeric(self) -> Numeric:
        """The numeric solver."""
        from vega_planner.robot.numeric import Numeric

        return Numeric(self.chain)

    def forward(self, q: Floats) -> tuple[Floats, Floats]:
        """Find where the nozzle is.

        Args:
            q: Joint positions [m, rad], shape (n, j).

        Returns:
            Tip positions [m] and unit vectors from the tip back along the nozzle, in the
            base frame, each (n, 3).
        """
        points, axes, sides = (np.zeros((len(q), 3)) for _ in range(3))
        q = np.ascontiguousarray(q, np.float64)
        kernels.forward_many(self.chain.arrays, q, points, axes, sides)
        return points, axes

    def solve(self, points: Floats, axes: Floats) -> IKSolutions:
        """Find joint configurations for targets.

        Args:
            points: Tip positions [m] in the base frame, shape (n, 3).
            axes: Unit vectors from the tip back along the nozzle, shape (n, 3).

        Returns:
            Both branches where the wrist has a closed form; otherwise a few numeric ones.
        """
        if self.closed_form is not None:
            q, valid, _ = self.closed_form.solve(points, axes)
            return IKSolutions(q, valid)
        q, found = self.numeric.solve(points, axes)
        return IKSolutions(q[:, None, :], found[:, None])

    def reachable(self, points: Floats, axes: Floats) -> Bools:
        """Tell which targets some joint configuration within the limits reaches.

        Args:
            points: Tip positions [m] in the base frame, shape (n, 3).
            axes: Unit vectors from the tip back along the nozzle, shape (n, 3).
        """
        if self.closed_form is not None:
            return np.asarray(self.closed_form.solve(points, axes, first_only=True)[1].any(1))
        return self.numeric.solve(points, axes)[1]

    def reach_reason(self, points: Floats, axes: Floats) -> Ints:
        """Tell why targets are not reached.

        Returns:
            REACHED (0), OUT_OF_TRAVEL (1: the wrist turns, but the tip does not get there)
            or WRIST_LIMIT (2: the tip gets there, but not with this axis), shape (n,).
        """
        if self.closed_form is not None:
            _, valid, wrist = self.closed_form.solve(points, axes, first_only=True)
            missing = np.where(wrist.any(1), OUT_OF_TRAVEL, WRIST_LIMIT)
            return np.where(valid.any(1), REACHED, missing)
        found = self.numeric.solve(points, axes)[1]
        reason = np.where(found, REACHED, OUT_OF_TRAVEL)
        missed = np.flatnonzero(~found)
        if len(missed):
            reason[missed[self.numeric.point_reached(points[missed])]] = WRIST_LIMIT
        return reason


def load_robot(spec: str) -> Robot:
    """Read a robot by name, or from a YAML, URDF or xacro file.

    Raises:
        InvalidInput: If there is no such robot.
        BadRobot: If a file is wrong, or it has fewer than five joints.
    """
    description = load_description(spec)
    return Robot(description.name, description.urdf, read_chain(description))
