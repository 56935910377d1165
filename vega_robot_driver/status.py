# SPDX-License-Identifier: Apache-2.0
"""The status page: what the real-time process tells, cycle by cycle, in shared memory.

A file of the state folder, mapped by both sides. It stays readable after either side died:
the kernel keeps what was written last.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vega_planner.datatypes import Floats
from vega_planner.errors import LinkTimeout
from vega_robot_driver.executor import STATES
from vega_robot_driver.mapped_file import map_file

#: Most axes a page has room for.
MOST_AXES = 8

_PAGE = np.dtype(
    [
        ("begin", "<u8"),
        ("pid", "<i8"),
        ("stamp", "<f8"),
        ("state", "<i4"),
        ("gate", "<i4"),
        ("u", "<f8"),
        ("rate", "<f8"),
        ("done", "<f8"),
        ("duration", "<f8"),
        ("path", "<i4"),
        ("layer", "<i4"),
        ("paths_done", "<i4"),
        ("axes", "<i4"),
        ("positions", "<f8", (MOST_AXES,)),
        ("targets", "<f8", (MOST_AXES,)),
        ("pressure", "<f8"),
        ("cycles", "<u8"),
        ("clock", "<f8"),
        ("idle_on_cycles", "<u8"),
        ("wrong_counters", "<u8"),
        ("overruns", "<u8"),
        ("lateness", "<f8", (3,)),
        ("homing_epoch", "<i8"),
        ("job", "S64"),
        ("detail", "S200"),
        ("end", "<u8"),
    ]
)
#: Where the two slots of the page lie, and the client's heartbeat after them.
_SLOTS = (0, 2048)
_HEARTBEAT = 4096
_SIZE = 8192


@dataclass(frozen=True, eq=False)
class MachineStatus:
    """One consistent reading of the status page. SI units.

    Attributes:
        pid: Process that wrote it.
        age: Seconds since it was written.
        state: State of the machine, one of `STATES`.
        dispenser_on: Command to the dispenser.
        u: Path time [s]; below 0 on the approach.
        rate: Rate of path time against the machine's clock.
        done: Path time up to which everything that should be deposited is [s].
        duration: Path time of the job's end [s].
        path: Current pass, -1 on travel.
        layer: Its layer, -1 where unknown.
        paths_done: Passes completed.
        positions: Measured joint positions, shape (j,).
        targets: Joint targets, shape (j,).
        pressure: Pressure in the barrel [Pa].
        cycles: Cycles since the start.
        clock: The machine's own time [s].
        idle_on_cycles: Cycles with the dispenser on while the path stood still; always 0.
        wrong_counters: Cycles with a wrong working counter.
        overruns: Cycles that began more than a cycle late.
        lateness: Median, 99th percentile and largest lateness of the last cycles [s].
        homing_epoch: Number of the axes' homing.
        job: Hash of the job, or empty.
        detail: Why the machine stopped, or empty.
    """

    pid: int
    age: float
    state: str
    dispenser_on: bool
    u: float
    rate: float
    done: float
    duration: float
    path: int
    layer: int
    paths_done: int
    positions: Floats
    targets: Floats
    pressure: float
    cycles: int
    clock: float
    idle_on_cycles: int
    wrong_counters: int
    overruns: int
    lateness: tuple[float, float, float]
    homing_epoch: int
    job: str
    detail: str

    @property
    def progress(self) -> float:
        """Progress by path time, 0 to 1."""
        return min(max(self.u / self.duration, 0.0), 1.0) if self.duration > 0 else 0.0

    @property
    def active(self) -> bool:
        """Whether a job runs or is paused."""
        return self.state in ("printing", "pausing", "paused", "stopping")


class StatusPage:
    """The page, from either side.

    Args:
        folder: State folder.
        create: Make a fresh page (the real-time process does).

    Raises:
        LinkTimeout: If there is no page to open.
    """

    def __init__(self, folder: Path, *, create: bool = False) -> None:
        missing = f"no machine has run in {folder}"
        self._memory = map_file(folder / "status", _SIZE, missing, create=create)
        self.record = np.zeros(1, _PAGE)
        self._sequence = 0

    def publish(self) -> None:
        """Show what `record` holds, in the slot that the last reading is not in.

        A writer that is killed in mid-write leaves the last reading whole.
        """
        self._sequence += 1
        self.record["begin"] = self.record["end"] = self._sequence
        # The end goes first and the beginning last: a reader that sees both equal, before
        # and after, has read one reading (stores are not reordered on x86).
        data, at = self.record.tobytes(), _SLOTS[self._sequence % 2]
        self._memory[at + len(data) - 8 : at + len(data)] = data[-8:]
        self._memory[at + 8 : at + len(data) - 8] = data[8:-8]
        self._memory[at : at + 8] = data[:8]

    def read(self) -> MachineStatus:
        """Read the latest status.

        Raises:
            LinkTimeout: If no consistent reading comes within many tries.
        """
        for tries in range(2_000):
            if tries > 10:
                time.sleep(0.001)  # the writer was interrupted in mid-write
            found = [data for at in _SLOTS if (data := self._whole(at)) is not None]
            if found:
                latest = max(found, key=lambda data: int.from_bytes(data[:8], "little"))
                return _status(np.frombuffer(latest, _PAGE)[0])
        raise LinkTimeout("the machine's status page is never at rest")

    def _whole(self, at: int) -> bytes | None:
        """Read a slot; None where it is being written or never was."""
        before = self._memory[at : at + 8]
        data = self._memory[at : at + _PAGE.itemsize]
        whole = before == data[:8] == data[-8:] == self._memory[at : at + 8]
        return data if whole else None

    def beat(self) -> None:
        """Say that the client lives."""
        self._memory[_HEARTBEAT : _HEARTBEAT + 8] = time.monotonic_ns().to_bytes(8, "little")

    @property
    def last_beat(self) -> int:
        """When the client last said that it lives [ns of the monotonic clock]."""
        return int.from_bytes(self._memory[_HEARTBEAT : _HEARTBEAT + 8], "little")


def _status(page: np.void) -> MachineStatus:
    axes = int(page["axes"])
    return MachineStatus(
        pid=int(page["pid"]),
        age=time.monotonic() - float(page["stamp"]),
        state=STATES[int(page["state"])],
        dispenser_on=bool(page["gate"]),
        u=float(page["u"]),
        rate=float(page["rate"]),
        done=float(page["done"]),
        duration=float(page["duration"]),
        path=int(page["path"]),
        layer=int(page["layer"]),
        paths_done=int(page["paths_done"]),
        positions=page["positions"][:axes].copy(),
        targets=page["targets"][:axes].copy(),
        pressure=float(page["pressure"]),
        cycles=int(page["cycles"]),
        clock=float(page["clock"]),
        idle_on_cycles=int(page["idle_on_cycles"]),
        wrong_counters=int(page["wrong_counters"]),
        overruns=int(page["overruns"]),
        lateness=tuple(page["lateness"].tolist()),
        homing_epoch=int(page["homing_epoch"]),
        job=page["job"].decode(),
        detail=page["detail"].decode(errors="replace"),
    )
