# SPDX-License-Identifier: Apache-2.0
"""What the axes may do: a job is checked as a whole, and every target at the last step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vega_planner.datatypes import Bools, Floats
from vega_planner.errors import InvalidInput
from vega_robot_driver.job import PrintJob

#: Share by which a speed limit may be exceeded: targets are samples of a curve.
SPEED_MARGIN = 0.05
#: What is still at a position limit [m, rad].
_AT_LIMIT = 1e-9


@dataclass(frozen=True, eq=False)
class Limits:
    """Limits of the axes.

    Attributes:
        lower: Lowest positions [m, rad], shape (j,).
        upper: Highest positions, shape (j,).
        velocity: Highest speeds [m/s, rad/s], shape (j,).
        acceleration: Highest accelerations [m/s², rad/s²], shape (j,), or None; the rate
            along the path does not change faster than they allow.
    """

    lower: Floats
    upper: Floats
    velocity: Floats
    acceleration: Floats | None = None

    def excess(self, targets: Floats, names: Sequence[str], dt: float) -> str:
        """Say which axis is sent too far or too fast, or nothing.

        Args:
            targets: The last targets and what is to follow them, shape (1 + c, j).
            names: Names of the axes.
            dt: Time between two targets [s].
        """
        low, high = targets[1:].min(0), targets[1:].max(0)
        outside = self._outside(low, high)
        if outside.any():
            k = int(np.argmax(outside))
            return f"{names[k]} was sent to {self._range(k, low, high)}"
        speed = np.abs(np.diff(targets, axis=0)).max(0) / dt
        fast = speed > self.velocity * (1 + SPEED_MARGIN)
        if fast.any():
            k = int(np.argmax(fast))
            return f"{names[k]} was sent at {speed[k]:g} /s; limit {self.velocity[k]:g}"
        return ""

    def check_job(self, job: PrintJob, names: tuple[str, ...], dt: float) -> None:
        """Check the whole of a job.

        Args:
            job: The job.
            names: Names of the axes.
            dt: Time between two targets [s].

        Raises:
            InvalidInput: If it has other joints, or leaves a limit anywhere.
        """
        if job.joint_names != names:
            raise InvalidInput(
                f"the job moves {', '.join(job.joint_names)}; the machine has {', '.join(names)}"
            )
        low, high, fastest, when = job.extremes(dt)
        outside = self._outside(low, high)
        if outside.any():
            k = int(np.argmax(outside))
            raise InvalidInput(f"the job sends {names[k]} to {self._range(k, low, high)}")
        fast = fastest > self.velocity * (1 + SPEED_MARGIN)
        if fast.any():
            k = int(np.argmax(fast))
            raise InvalidInput(
                f"the job moves {names[k]} at {fastest[k]:g} /s, {when[k]:.2f} s after its "
                f"start; limit {self.velocity[k]:g}"
            )

    def _outside(self, low: Floats, high: Floats) -> Bools:
        return (low < self.lower - _AT_LIMIT) | (high > self.upper + _AT_LIMIT)

    def _range(self, k: int, low: Floats, high: Floats) -> str:
        limits = f"{self.lower[k]:g} .. {self.upper[k]:g}"
        return f"{low[k]:g} .. {high[k]:g}; limits {limits}"
