# SPDX-License-Identifier: Apache-2.0
"""An emulated line and its time: frames, faults, and what the drives saw."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

from vega_robot_driver.emulators.axis import Axis, Forces
from vega_robot_driver.emulators.cia402_drive import Cia402Drive
from vega_robot_driver.emulators.faults import inject
from vega_robot_driver.emulators.segment import Segment
from vega_robot_driver.emulators.slave_controller import SlaveController
from vega_robot_driver.emulators.witness import Witness
from vega_robot_driver.motion.bus_config import BusConfig


def build_segment(config: BusConfig) -> Segment:
    """Build a drive for each axis of a bus, at joint position 0 or the nearest it reaches."""
    slaves = []
    for axis in config.axes:
        low, high = sorted((axis.increments(axis.lower), axis.increments(axis.upper)))
        at = float(min(max(axis.increments(0.0), low), high))
        model = Axis(
            travel=(low - 10.0, high + 10.0),
            speed_limit=abs(axis.scale) * axis.velocity * 1.5,
            acceleration_limit=abs(axis.scale) * axis.velocity * 100.0,
            position=at,
            absolute=axis.homing is None,
            origin=0 if axis.homing is None else -round(at),
            forces=Forces(scale=abs(axis.scale), **axis.emulated) if axis.emulated else None,
            chance=random.Random(axis.known_by[1]),
        )
        identity = (axis.vendor, axis.product, 0x00010000, axis.serial)
        drive = Cia402Drive(model, identity)
        slaves.append(SlaveController(drive, f"EMU-{axis.joint}", axis.alias))
    return Segment(slaves)


class Line:
    """Drives on a line.

    Args:
        segment: The drives.
        cycle: Time that passes with each cyclic frame [s].
    """

    def __init__(self, segment: Segment, cycle: float) -> None:
        self.segment, self.now = segment, 0.0
        self._cycle, self._due = cycle, 0
        self._witness = Witness(segment)

    def frame(self, data: bytes) -> bytes | None:
        """Send a frame down the line; None where it does not come back.

        The time that it takes passes with `settle`: what comes back is of the time before.
        """
        return self.segment.process(data)

    def settle(self) -> None:
        """Let the time of the frames since the last call pass."""
        while self._due < self.segment.cycles:
            self._due += 1
            self.pass_time(self._cycle)

    def pass_time(self, dt: float) -> None:
        """Let time pass [s]."""
        self.now += dt
        self.segment.tick(self.now, min(dt, 0.05))
        self._witness.look(self.now)

    def obey(self, message: dict[str, Any]) -> None:
        """Follow a command: a fault and its number, or `trace` with a path or without."""
        kind, number = message["fault"], int(message.get("number", 0))
        if kind == "silence":
            self._witness.mark(self.now)
            for _ in range(number):
                self.pass_time(0.001)
        elif kind == "trace":
            self._witness.keep(Path(message["path"]) if message.get("path") else None)
        else:
            inject(self.segment, kind, number)
            if kind != "none":
                self._witness.mark(self.now)

    def told(self) -> dict[str, Any]:
        """What the drives do."""
        return {
            "time": self.now,
            "cycles": self.segment.cycles,
            **self._witness.told(),
            "drives": [
                {
                    "bus_state": slave.state,
                    "state": slave.drive.state.value,
                    "position": slave.drive.axis.position,
                    "speed": slave.drive.axis.speed,
                    "outputs": slave.drive.objects.entry(0x60FE, 1).value,
                    "error": slave.drive.objects[0x603F],
                    "largest_change": slave.drive.largest_change,
                }
                for slave in self.segment.slaves
            ],
        }
