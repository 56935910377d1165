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
import select
import socket
import sys
import time
from pathlib import Path

from vega_robot_driver.emulators.line import Line, build_segment
from vega_robot_driver.motion.bus_config import read_bus_config

_ETHERTYPE = 0x88A4
#: Time between two looks at the clock, and between two status files [s].
TICK, SHOW = 0.001, 0.02
#: Time the drives go on after their master's process is gone [s].
AFTERLIFE = 10.0


class Server:
    """Answers frames, lets time pass, obeys fault injections, and writes what the drives do."""

    def __init__(self, line: Line, interface: str, status: Path, by_clock: bool, commands: int):
        self._line, self._status, self._by_clock = line, status, by_clock
        self._wire = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(_ETHERTYPE))
        self._wire.bind((interface, _ETHERTYPE))
        self._wire.setblocking(False)
        self._commands = socket.socket(fileno=commands)

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
                if self._by_clock:
                    self._line.pass_time(now - self._line.now)
            if now >= next_show:
                next_show = now + SHOW
                self._show()

    def _serve_frames(self) -> None:
        while True:
            try:
                frame = self._wire.recv(1600)
            except BlockingIOError:
                return
            answer = self._line.frame(frame)
            if answer is not None:
                self._wire.send(answer)

    def _obey(self) -> bool:
        data = self._commands.recv(4096)
        if not data:
            return False
        self._line.obey(json.loads(data))
        self._show()
        self._commands.send(b"{}")
        return True

    def _show(self) -> None:
        fresh = self._status.with_suffix(".new")
        with contextlib.suppress(OSError):
            fresh.write_text(json.dumps(self._line.told()))
            fresh.replace(self._status)


def main() -> None:
    """Run the server."""
    interface, config, status, cycle, commands = sys.argv[1:6]
    by_clock = float(cycle) == 0.0
    now = time.monotonic() if by_clock else 0.0
    line = Line(build_segment(read_bus_config(config)), float(cycle), now)
    server = Server(line, interface, Path(status), by_clock, int(commands))
    if by_clock:  # below the master's priority, above everything else; it may be refused
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(70))
    print("ready", flush=True)
    with contextlib.suppress(KeyboardInterrupt):
        server.run()
    os._exit(0)


if __name__ == "__main__":
    main()
