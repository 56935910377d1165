# SPDX-License-Identifier: Apache-2.0
"""What the drives see of a machine's safety: who moves, and when the valve is open."""

from __future__ import annotations

from array import array
from pathlib import Path
from typing import Any

from vega_robot_driver.emulators.segment import Segment

#: Speed below which an axis stands [increments/s], and how long none may have moved until that
#: is a standstill [s]: nothing that looks at the axes cycle by cycle sees it sooner.
STANDING, SETTLED = 1.0, 0.02


class Witness:
    """Looks at the drives after each step of time.

    Args:
        segment: The drives.
    """

    def __init__(self, segment: Segment) -> None:
        self._drives = [slave.drive for slave in segment.slaves]
        self._outputs = [drive.objects.entry(0x60FE, 1) for drive in self._drives]
        self._on_at_standstill = 0
        self._moved = self._opened = self._looked = self._stood = 0.0
        self._marked: dict[str, float] = {}
        self._path: Path | None = None
        self._trace = array("d")

    def look(self, now: float) -> None:
        """Note what is so at this time."""
        on = any(output.value for output in self._outputs)
        moving = any(abs(drive.axis.speed) >= STANDING for drive in self._drives)
        self._stood = 0.0 if moving else self._stood + min(now - self._looked, SETTLED / 10)
        self._looked = now
        if moving:
            self._moved = now
        self._on_at_standstill += on and self._stood > SETTLED
        if on:
            self._opened = now
        if self._path is not None:
            self._trace.extend((now, on, *(drive.axis.position for drive in self._drives)))

    def mark(self, now: float) -> None:
        """Remember when something was made to fail."""
        self._marked = {"injected": now, "on_at_standstill_before": self._on_at_standstill}
        for drive in self._drives:
            drive.largest_change = 0.0

    def keep(self, path: Path | None) -> None:
        """Begin to keep every step; or, without a path, write what was kept and end.

        The file holds float64 rows: time, whether the valve is open, positions [increments].
        """
        if path is None and self._path is not None:
            self._path.write_bytes(self._trace.tobytes())
        self._path, self._trace = path, array("d")

    def told(self) -> dict[str, Any]:
        """Tell when something last moved and was open, in the drives' own time."""
        return {
            "on_at_standstill": self._on_at_standstill,
            "last_moving": self._moved,
            "last_open": self._opened,
            **self._marked,
        }
