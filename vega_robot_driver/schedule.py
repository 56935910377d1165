# SPDX-License-Identifier: Apache-2.0
"""An absolute schedule of cycles, and how late they begin."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

#: Overruns in a row after which the machine stops.
MOST_OVERRUNS = 25
#: Cycles that percentiles are taken of, and cycles between two looks at them.
_KEPT, _LOOK = 1000, 200


class Schedule:
    """Wakes up once a period; what is missed is not made up for.

    Args:
        period: Time between two cycles [s].
        clock: Tells the time [s].
        sleep: Waits for a time [s].

    Attributes:
        overruns: Cycles that began more than a period late.
        lateness: Median, 99th percentile and largest lateness of the last cycles [s].
    """

    def __init__(
        self,
        period: float,
        *,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.period = period
        self._clock, self._sleep = clock, sleep
        self._wake = clock()
        self.overruns = self._streak = 0
        self.lateness = [0.0, 0.0, 0.0]
        self._late = np.zeros(_KEPT)
        self._count = 0

    @property
    def overrun(self) -> bool:
        """Whether so many cycles in a row began late that the machine must stop."""
        return self._streak >= MOST_OVERRUNS

    def wait(self, correction: float = 0.0) -> None:
        """Wait for the next cycle.

        Args:
            correction: Time by which it should come later [s].
        """
        self._wake += self.period + correction
        ahead = self._wake - self._clock()
        if ahead > 0:
            self._sleep(ahead)
        late = self._clock() - self._wake
        self._late[self._count % _KEPT] = late
        self._count += 1
        if self._count % _LOOK == 0:
            known = np.sort(self._late[: min(self._count, _KEPT)])
            self.lateness = [float(known[int((len(known) - 1) * q)]) for q in (0.5, 0.99, 1.0)]
        if late <= self.period:
            self._streak = 0
            return
        self.overruns += 1
        self._streak += 1
        self._wake += late
