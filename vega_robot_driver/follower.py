# SPDX-License-Identifier: Apache-2.0
"""Following a path along its parameter: the rate ramps, the path stays.

The rate of path time against the clock changes within a ramp, and never so fast that a joint
would exceed its acceleration: with q(u) the path and r its rate, the joints accelerate by
q' dr/dt + q'' r², and dr/dt is kept where that is within the limit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vega_planner.datatypes import Bools, Floats
from vega_robot_driver.curve import Curve

#: Rate of the path parameter below which nothing is dispensed.
RATE_FLOOR = 0.05
#: Joint speed below which a joint sets no bound on the rate's change [m/s, rad/s].
_SLOW = 1e-9
#: Share of the acceleration limit that is used: targets are samples of the curve, and their
#: differences are a little larger than its derivatives.
_SHARE = 0.95


@dataclass(frozen=True, eq=False)
class Cycles:
    """What some cycles ask of the machine.

    Attributes:
        targets: Joint targets [m, rad], shape (c, j).
        speeds: Their velocities [m/s, rad/s], shape (c, j).
        gate: Dispenser outputs, shape (c,).
        u: Path times [s], shape (c,).
        done: Path times up to which everything that should be deposited is [s], (c,).
    """

    targets: Floats
    speeds: Floats
    gate: Bools
    u: Floats
    done: Floats


class Follower:
    """A way to the path, the path, and where on it the machine is.

    Args:
        approach: The way there, from rest to rest; it ends in path time where `path` begins.
        path: The path; the rate is 0 where it is joined.
        spans: Path times between which the dispenser is on [s], rising, shape (k, 2).
        done: Path time up to which everything is deposited already [s].
        dt: Cycle time [s].
        ramp_s: Time in which the rate goes from 0 to 1 and back, at least.
        acceleration: Largest joint accelerations [m/s², rad/s²], shape (j,), or None.
    """

    def __init__(
        self,
        approach: Curve,
        path: Curve,
        spans: Floats,
        *,
        done: float,
        dt: float,
        ramp_s: float,
        acceleration: Floats | None = None,
    ) -> None:
        self._curves = (approach, path)
        self._on, self._off = np.ascontiguousarray(spans[:, 0]), np.ascontiguousarray(spans[:, 1])
        self._dt, self._steepest = dt, 1.0 / ramp_s
        self._most = None if acceleration is None else _SHARE * acceleration
        self._leg = 0
        self.u, self.rate, self.done = approach.begin, 0.0, done

    @property
    def first(self) -> Floats:
        """Joint positions it starts from, shape (j,)."""
        return self._curves[0].positions[0]

    @property
    def ended(self) -> bool:
        """Whether the path is at its end."""
        return self._leg == 1 and self.u >= self._curves[1].end

    def advance(self, cycles: int, want: float, allowed: bool) -> Cycles:
        """Go on by some cycles.

        Args:
            cycles: Their number.
            want: Rate to ramp to, 0 to stop.
            allowed: Whether the dispenser may be on at all.
        """
        joints = len(self.first)
        u, rates = np.empty(cycles), np.empty(cycles)
        targets, speeds = np.empty((cycles, joints)), np.empty((cycles, joints))
        at = 0
        while at < cycles:
            curve = self._curves[self._leg]
            if self._leg == 0 and self.u >= curve.end:
                self._leg = 1
                continue
            count = self._run(curve, want, cycles - at, u[at:], rates[at:])
            rows = slice(at, at + count)
            targets[rows], slopes, _ = curve(u[rows])
            speeds[rows] = slopes * rates[rows, None]
            at += count
        return self._gated(targets, speeds, u, rates, allowed)

    def rewind(self, cycles: Cycles, good: int, done: float) -> None:
        """Take back what followed the first `good` of the last cycles, and stand.

        Args:
            cycles: What `advance` gave last.
            good: Cycles that took place.
            done: `done` before them.
        """
        self.u = float(cycles.u[max(good - 1, 0)])
        self.done = float(cycles.done[good - 1]) if good else done
        self.rate = 0.0

    def _run(self, curve: Curve, want: float, most: int, u: Floats, rates: Floats) -> int:
        """Fill path times and rates of one cycle, or of many at a steady rate."""
        if self.rate != want:
            self.rate += self._change(curve, want)
            u[0] = self.u + self.rate * self._dt
            count = 1
        else:
            u[:most] = self.u + self.rate * self._dt * np.arange(1, most + 1)
            count = most
        rates[:count] = self.rate
        over = int(np.searchsorted(u[:count], curve.end))
        if over < count:
            count = over + 1
            u[over], rates[over], self.rate = curve.end, 0.0, 0.0
        self.u = float(u[count - 1])
        return count

    def _change(self, curve: Curve, want: float) -> float:
        """Find the change of the rate in one cycle."""
        wish = want - self.rate
        up = down = self._steepest
        if self._most is not None:
            _, slope, bend = curve(np.array([self.u]))
            speed, turn = np.abs(slope[0]), np.sign(slope[0]) * bend[0] * self.rate**2
            moving = speed > _SLOW
            if moving.any():
                room, speed, turn = self._most[moving], speed[moving], turn[moving]
                up = min(up, max(float(((room - turn) / speed).min()), 0.0))
                down = min(down, max(float(((room + turn) / speed).min()), 0.0))
        return min(max(wish, -down * self._dt), up * self._dt)

    def _gated(
        self, targets: Floats, speeds: Floats, u: Floats, rates: Floats, allowed: bool
    ) -> Cycles:
        span = self._off.searchsorted(u, "right")
        inside = np.zeros(len(u), np.bool_)
        some = span < len(self._on)
        inside[some] = u[some] >= self._on[span[some]]
        reach = u
        if not allowed:  # what should have been deposited from here on is not
            left = int(self._off.searchsorted(self.done + 1e-12, "right"))
            if left < len(self._on):
                reach = np.minimum(u, self._on[left])
        done = np.maximum(reach, self.done)
        self.done = float(done[-1])
        gate = inside & (rates > RATE_FLOOR) if allowed else np.zeros(len(u), np.bool_)
        return Cycles(targets, speeds, gate, u, done)
