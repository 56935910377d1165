# SPDX-License-Identifier: Apache-2.0
"""An emulated Musashi dispenser on a pseudo-terminal."""

from __future__ import annotations

import os
import pty
import select
import threading
import tty

from vega_planner.errors import LinkTimeout
from vega_robot_driver.dispenser.musashi import ACCEPTED, ACK, ENQ, ETX, REJECTED, frame, unframe

#: Highest pressure it takes, in tenths of a kilopascal.
HIGHEST = 2000


class MusashiDevice:
    """Answers on `port` until closed.

    Attributes:
        port: The terminal to open.
        pressure: Set pressure in tenths of a kilopascal.
        commands: Commands it executed.
        misbehaviour: "", "silent" (answers nothing), "garble" (one damaged answer) or
            "lose_verdict" (executes one command and does not say so).
    """

    def __init__(self, pressure: int = 1300) -> None:
        self._end, other = pty.openpty()
        tty.setraw(self._end)
        tty.setraw(other)
        self._other = other
        self.port = os.ttyname(other)
        self.pressure = pressure
        self.commands: list[bytes] = []
        self.misbehaviour = ""
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End."""
        self._closed.set()
        self._thread.join()
        os.close(self._end)
        os.close(self._other)

    def _byte(self, seconds: float = 0.1) -> bytes:
        ready, _, _ = select.select([self._end], [], [], seconds)
        return os.read(self._end, 1) if ready else b""

    def _run(self) -> None:
        while not self._closed.is_set():
            if self._byte() != ENQ or self.misbehaviour == "silent":
                continue
            os.write(self._end, ACK)
            data = b""
            while (byte := self._byte()) and byte != ETX:
                data += byte
            self._answer(data + ETX)

    def _answer(self, data: bytes) -> None:
        try:
            body = unframe(data)
        except LinkTimeout:
            os.write(self._end, frame(REJECTED))
            return
        answer = self._execute(body)
        verdict = frame(REJECTED if answer is None else ACCEPTED)
        if self.misbehaviour == "garble":
            self.misbehaviour = ""
            verdict = verdict[:3] + b"?" + verdict[4:]
        if self.misbehaviour == "lose_verdict":
            self.misbehaviour = ""
            return
        os.write(self._end, verdict)
        if answer and self._byte(0.3) == ACK:
            os.write(self._end, frame(answer))

    def _execute(self, body: bytes) -> bytes | None:
        """Execute a command; returns its answer, empty where it has none, None if rejected."""
        self.commands.append(body)
        if body[:2] == b"UL" and body[5:] == b"D01":
            return b"DA01P%04dT00100V0000M1N%-10s" % (self.pressure, b"SE1700")
        if body[:4] == b"PR  " and body[5:9].isdigit() and int(body[5:9]) <= HIGHEST:
            self.pressure = int(body[5:9])
            return b""
        return None
