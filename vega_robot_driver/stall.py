# SPDX-License-Identifier: Apache-2.0
"""Noticing that an axis stands while it is sent along a bead, before its drive does.

A drive trips when the following error leaves its window: at the speed of a bead that takes
some hundred milliseconds, in which the dispenser would make a blob. An axis that has hardly
moved for a few cycles while its target did, and has fallen behind, is stalled.
"""

from __future__ import annotations

from collections import deque

import numpy as np

from vega_planner.datatypes import Floats

#: Time over which motion is compared [s].
WINDOW_S = 0.008
#: Way of a target in that time, and lag, below which nothing is concluded; as times at the
#: joint's speed limit [s]: 20 µm and 50 µm on an axis of 0.5 m/s.
LEAST_WAY_S, LEAST_LAG_S = 4e-5, 1e-4
#: Share of the target's way below which an axis stands.
STANDING = 0.02


class StallWatch:
    """Compares the ways of targets and axes.

    Args:
        velocity: Joint speed limits [m/s, rad/s], shape (j,).
        dt: Cycle time [s].
    """

    def __init__(self, velocity: Floats, dt: float) -> None:
        self._way, self._lag = LEAST_WAY_S * velocity, LEAST_LAG_S * velocity
        self._dt, self._velocity = dt, velocity
        self._past: deque[tuple[int, Floats, Floats]] = deque()

    def clear(self) -> None:
        """Forget the past."""
        self._past.clear()

    def stalled(self, cycles: int, target: Floats, position: Floats) -> int:
        """Look at the axes after some cycles.

        Args:
            cycles: Cycles since the last look.
            target: Where the axes were sent, shape (j,).
            position: Where they were found, shape (j,).

        Returns:
            The axis that stands, or -1.
        """
        past, least = self._past, round(WINDOW_S / self._dt)
        past.append((cycles, target, position))
        age = sum(row[0] for row in past) - past[0][0]
        while len(past) > 2 and age - past[1][0] >= least:
            age -= past[1][0]
            past.popleft()
        if age < least:
            return -1
        _, sent, found = past[0]
        way = np.abs(target - sent)
        stands = np.abs(position - found) < STANDING * way
        late = np.abs(target - position) > self._lag
        bad = (way > self._way) & stands & late
        return int(bad.argmax()) if bad.any() else -1
