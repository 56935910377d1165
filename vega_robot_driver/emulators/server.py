# SPDX-License-Identifier: Apache-2.0
"""An emulated segment on a network interface, in a process of its own.

The drives' time is the frames': each cyclic frame is one cycle, however late it comes, so that
they give the same answers whatever the computer's load. Where no frame comes for longer than
any load explains, or the master's process is gone, their time goes on with the clock: drives
whose master is dead stop by themselves.
"""

from __future__ import annotations

import contextlib
import json
import select
import socket
import time
from pathlib import Path

from vega_robot_driver.emulators.line import Line

_ETHERTYPE = 0x88A4
#: Time between two looks at the clock, and between two status files [s].
TICK, SHOW = 0.001, 0.02
#: Silence after which a master that lives is taken for frozen [s], and time without a look at
#: the clock after which this process was held up itself and that silence counts anew [s].
PATIENCE, HELD_UP = 1.0, 0.1
#: Time the drives go on after their master's process is gone [s].
AFTERLIFE = 10.0


class Server:
    """Answers frames, lets time pass, obeys fault injections, and writes what the drives do.

    Args:
        line: The drives; their time is the frames'.
        interface: Network interface of their end.
        status: File into which is written what they do.
        commands: Socket of the master's process; its end is that process's.
    """

    def __init__(self, line: Line, interface: str, status: Path, commands: socket.socket):
        self._line, self._status = line, status
        self._wire = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(_ETHERTYPE))
        self._wire.bind((interface, _ETHERTYPE))
        self._wire.setblocking(False)
        self._commands = commands

    def run(self) -> None:
        """Serve until the master's process is long gone."""
        watch = select.epoll()
        watch.register(self._wire, select.EPOLLIN)
        watch.register(self._commands, select.EPOLLIN)
        looked = heard = time.monotonic()
        next_show = looked
        gone: float | None = None
        while gone is None or looked - gone < AFTERLIFE:
            for number, _ in watch.poll(TICK):
                if number == self._wire.fileno():
                    self._serve_frames()
                    heard = time.monotonic()
                elif not self._obey():
                    watch.unregister(self._commands)
                    gone = time.monotonic()
            now = time.monotonic()
            if now - looked > HELD_UP:
                heard = now
            if gone is not None or now - heard > PATIENCE:
                self._line.pass_time(now - looked)
            looked = now
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
            self._line.settle()  # while the master computes its next cycle

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
