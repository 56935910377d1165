# SPDX-License-Identifier: Apache-2.0
"""An emulated segment on a network interface, in a process of its own.

Runs as `python -m vega_robot_driver.emulators.server INTERFACE BUS_YAML STATUS_FILE CYCLE FD`.
With a CYCLE above 0 each cyclic frame is one cycle of simulated time: the drives then give the
same answers whatever the computer's load. With 0 they run by the clock.
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import select
import socket
import sys
import time
from pathlib import Path
from typing import Any

from vega_robot_driver.emulators.axis import Axis, Forces
from vega_robot_driver.emulators.cia402_drive import Cia402Drive
from vega_robot_driver.emulators.faults import inject
from vega_robot_driver.emulators.segment import Segment
from vega_robot_driver.emulators.slave_controller import SlaveController
from vega_robot_driver.emulators.witness import Witness
from vega_robot_driver.motion.bus_config import BusConfig, read_bus_config

_ETHERTYPE = 0x88A4
#: Time between two looks at the clock, and between two status files [s].
TICK, SHOW = 0.001, 0.02
#: Time the drives go on after their master's process is gone [s].
AFTERLIFE = 10.0


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
            forces=Forces(scale=axis.scale, **axis.emulated) if axis.emulated else None,
            chance=random.Random(axis.serial),
        )
        identity = (axis.vendor, axis.product, 0x00010000, axis.serial)
        slaves.append(SlaveController(Cia402Drive(model, identity), f"EMU-{axis.joint}"))
    return Segment(slaves)


class Server:
    """Answers frames, lets time pass, obeys fault injections, and writes what the drives do."""

    def __init__(
        self, segment: Segment, interface: str, status: Path, cycle: float, commands: int
    ):
        self._segment, self._status, self._cycle = segment, status, cycle
        self._wire = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(_ETHERTYPE))
        self._wire.bind((interface, _ETHERTYPE))
        self._wire.setblocking(False)
        self._commands = socket.socket(fileno=commands)
        self._now = 0.0 if cycle else time.monotonic()
        self._witness = Witness(segment)

    def run(self) -> None:
        """Serve until the master's process is long gone."""
        watch = select.epoll()
        watch.register(self._wire, select.EPOLLIN)
        watch.register(self._commands, select.EPOLLIN)
        next_tick = next_show = time.monotonic()
        gone: float | None = None
        while gone is None or time.monotonic() - gone < AFTERLIFE:
            for number, _ in watch.poll(max(0.0, next_tick - time.monotonic())):
                if number == self._wire.fileno():
                    self._serve_frames()
                elif not self._obey():
                    watch.unregister(self._commands)
                    gone = time.monotonic()
            now = time.monotonic()
            if now >= next_tick:
                next_tick = now + TICK
                if not self._cycle:
                    self._pass_time(now - self._now)
            if now >= next_show:
                next_show = now + SHOW
                self._show()

    def _serve_frames(self) -> None:
        while True:
            try:
                frame = self._wire.recv(1600)
            except BlockingIOError:
                return
            before = self._segment.cycles
            answer = self._segment.process(frame)
            if self._cycle and self._segment.cycles != before:
                self._pass_time(self._cycle)
            if answer is not None:
                self._wire.send(answer)

    def _pass_time(self, dt: float) -> None:
        self._now += dt
        self._segment.tick(self._now, min(dt, 0.05))
        self._witness.look(self._now)

    def _obey(self) -> bool:
        data = self._commands.recv(4096)
        if not data:
            return False
        message: dict[str, Any] = json.loads(data)
        kind, number = message["fault"], int(message.get("number", 0))
        if kind == "silence":  # milliseconds without a frame, in simulated time
            for _ in range(number):
                self._pass_time(0.001)
        elif kind == "trace":
            self._witness.keep(Path(message["path"]) if message.get("path") else None)
        else:
            inject(self._segment, kind, number)
            if kind != "none":
                self._witness.mark(self._now)
        self._show()
        self._commands.send(b"{}")
        return True

    def _show(self) -> None:
        drives = [slave.drive for slave in self._segment.slaves]
        shown = {
            "time": self._now,
            "cycles": self._segment.cycles,
            **self._witness.told(),
            "drives": [
                {
                    "bus_state": slave.state,
                    "state": drive.state.value,
                    "position": drive.axis.position,
                    "speed": drive.axis.speed,
                    "outputs": drive.objects.entry(0x60FE, 1).value,
                    "error": drive.objects[0x603F],
                    "largest_change": drive.largest_change,
                }
                for slave, drive in zip(self._segment.slaves, drives, strict=True)
            ],
        }
        fresh = self._status.with_suffix(".new")
        with contextlib.suppress(OSError):
            fresh.write_text(json.dumps(shown))
            fresh.replace(self._status)


def main() -> None:
    """Run the server."""
    interface, config, status, cycle, commands = sys.argv[1:6]
    segment = build_segment(read_bus_config(config))
    server = Server(segment, interface, Path(status), float(cycle), int(commands))
    print("ready", flush=True)
    with contextlib.suppress(KeyboardInterrupt):
        server.run()
    os._exit(0)


if __name__ == "__main__":
    main()
