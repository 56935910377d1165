# SPDX-License-Identifier: Apache-2.0
"""A joint path between samples: a cubic through positions and velocities."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Floats

#: Intervals that are looked at together when a whole curve is searched.
_CHUNK = 20_000


class Curve:
    """The cubic Hermite curve through samples in path time.

    Plain array arithmetic: a single cycle costs some tens of microseconds, many cost little
    more, and the real-time process needs no compiled kernel for it.

    Args:
        times: Strictly rising path times [s], shape (n,), n >= 2.
        positions: Joint positions [m, rad], shape (n, j).
        velocities: Their derivatives by path time, shape (n, j).
    """

    def __init__(self, times: Floats, positions: Floats, velocities: Floats) -> None:
        self.times, self.positions, self.velocities = times, positions, velocities
        self.begin, self.end = float(times[0]), float(times[-1])

    def __call__(self, u: Floats) -> tuple[Floats, Floats, Floats]:
        """Evaluate the curve.

        Args:
            u: Path times [s], shape (c,); held at the ends beyond them.

        Returns:
            Positions, and their first and second derivatives by path time, shape (c, j).
        """
        times = self.times
        i = np.minimum(np.maximum(times.searchsorted(u, "right") - 1, 0), len(times) - 2)
        h = (times[i + 1] - times[i])[:, None]
        s = np.minimum(np.maximum((u[:, None] - times[i][:, None]) / h, 0.0), 1.0)
        p0, v0, v1 = self.positions[i], self.velocities[i] * h, self.velocities[i + 1] * h
        way = self.positions[i + 1] - p0
        # p0 + s v0 + s² c + s³ d, with c and d from the far end
        c, d = 3 * way - 2 * v0 - v1, v0 + v1 - 2 * way
        place = p0 + s * (v0 + s * (c + s * d))
        return place, (v0 + s * (2 * c + 3 * s * d)) / h, (2 * c + 6 * s * d) / (h * h)

    def from_time(self, start: float) -> Curve:
        """Cut the curve at a path time, with a new sample exactly there."""
        if start <= self.begin:
            return self
        start = min(start, self.end - 1e-9)
        place, speed, _ = self(np.array([start]))
        rest = slice(int(self.times.searchsorted(start, "right")), None)
        return Curve(
            np.concatenate([[start], self.times[rest]]),
            np.concatenate([place, self.positions[rest]]),
            np.concatenate([speed, self.velocities[rest]]),
        )

    def extremes(self, dt: float) -> tuple[Floats, Floats, Floats, Floats]:
        """Find what the curve asks of the joints at full speed, looking every `dt`.

        Returns:
            Lowest and highest positions, largest speeds and the path times of these [s],
            each of shape (j,).
        """
        low, high = self.positions.min(0), self.positions.max(0)
        fast, when = np.zeros(len(low)), np.zeros(len(low))
        step = np.diff(self.times)
        counts = np.maximum(2, np.ceil(step / dt - 1e-9)).astype(np.int64)
        for at in range(0, len(step), _CHUNK):
            count = counts[at : at + _CHUNK]
            first = np.repeat(np.cumsum(count) - count, count)
            share = (np.arange(len(first)) - first) / np.repeat(count, count)
            u = np.repeat(self.times[at : at + len(count)], count)
            u = np.append(u + share * np.repeat(step[at : at + _CHUNK], count), self.end)
            places, speeds, _ = self(u)
            low = np.minimum(low, places.min(0))
            high = np.maximum(high, places.max(0))
            speeds = np.abs(speeds)
            rows, columns = speeds.argmax(0), np.arange(len(fast))
            more = speeds[rows, columns] > fast
            fast = np.where(more, speeds[rows, columns], fast)
            when = np.where(more, u[rows], when)
        return low, high, fast, when
