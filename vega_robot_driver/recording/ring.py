# SPDX-License-Identifier: Apache-2.0
"""Cycles on their way from the real-time process to the recorder: a ring in shared memory."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from vega_robot_driver.executor import STATES, Executor
from vega_robot_driver.mapped_file import map_file
from vega_robot_driver.status import MOST_AXES

ROW = np.dtype(
    [
        ("clock", "<f8"),
        ("u", "<f8"),
        ("rate", "<f8"),
        ("pressure", "<f8"),
        ("state", "<i4"),
        ("gate", "<i4"),
        ("path", "<i4"),
        ("layer", "<i4"),
        ("positions", "<f8", (MOST_AXES,)),
        ("targets", "<f8", (MOST_AXES,)),
        ("wrong_counters", "<i8"),
    ]
)
#: Rows that the ring holds: 16 s at 500 Hz.
ROOM = 8192
_COUNT = 8


class Ring:
    """The ring, from either side.

    Args:
        path: Its file.
        create: Make a fresh ring (the real-time process does).

    Raises:
        LinkTimeout: If there is no ring to open.
    """

    def __init__(self, path: Path, *, create: bool = False) -> None:
        size = _COUNT + ROOM * ROW.itemsize
        self._memory = map_file(path, size, f"no ring at {path}", create=create)
        self._row = np.zeros(1, ROW)
        self._put = 0

    def put(self, executor: Executor) -> None:
        """Add what the last cycle was."""
        row, axes, job = self._row, len(executor.positions), executor.job
        row["clock"] = executor.cycles * executor.motion.dt
        row["u"], row["rate"], row["pressure"] = executor.u, executor.rate, executor.pressure
        row["state"], row["gate"] = STATES.index(executor.state), executor.gate
        row["path"] = path = executor.path
        row["layer"] = job.layer_of(path) if job else -1
        row["positions"][0, :axes], row["targets"][0, :axes] = executor.positions, executor.targets
        row["wrong_counters"] = executor.motion.quality.wrong_counters
        at = _COUNT + self._put % ROOM * ROW.itemsize
        self._memory[at : at + ROW.itemsize] = row.tobytes()
        self._put += 1  # told after the row is there (stores are not reordered on x86)
        self._memory[:_COUNT] = self._put.to_bytes(_COUNT, "little")

    @property
    def written(self) -> int:
        """Rows that were written until now."""
        return int.from_bytes(self._memory[:_COUNT], "little")

    def take(self, since: int) -> tuple[np.ndarray, int, int]:
        """Read the rows after the first `since`.

        Returns:
            The rows, how many rows were written until now, and how many are lost because
            the ring came round before they were read.
        """
        written = self.written
        first = max(since, written - ROOM // 2)
        indices = [number % ROOM for number in range(first, written)]
        size = ROW.itemsize
        data = b"".join(self._memory[_COUNT + k * size : _COUNT + (k + 1) * size] for k in indices)
        return np.frombuffer(data, ROW), written, first - since
