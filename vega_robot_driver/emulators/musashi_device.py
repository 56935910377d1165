# SPDX-License-Identifier: Apache-2.0
"""An emulated Musashi dispenser on a pseudo-terminal."""

from __future__ import annotations

import os
import pty
import select
import threading
import time
import tty

from vega_planner.errors import LinkTimeout
from vega_robot_driver.dispenser.musashi_line import (
    ACCEPTED,
    ACK,
    ENQ,
    EOT,
    ETX,
    REJECTED,
    frame,
    unframe,
)

#: Highest pressure it takes, in tenths of a kilopascal.
HIGHEST = 2000


class MusashiDevice:
    """Answers on `port` until closed.

    Args:
        pressure: Set pressure in tenths of a kilopascal.
        dialect: Family whose commands it understands.

    Attributes:
        port: The terminal to open.
        pressure: Set pressure in tenths of a kilopascal.
        time_ms: Time of a shot in timed mode.
        vacuum: Vacuum in hundredths of a kilopascal.
        timed: Whether it is in timed mode; in steady mode a start is a toggle.
        commands: Commands it executed.
        misbehaviour: "", "silent" (answers nothing), "garble" (one damaged answer),
            "lose_verdict" (executes one command and does not say so), or "lose_start" (does
            so with the next start of a shot).
    """

    def __init__(self, pressure: int = 1300, dialect: str = "super_sigma") -> None:
        self._end, other = pty.openpty()
        tty.setraw(self._end)
        tty.setraw(other)
        self._other = other
        self.port = os.ttyname(other)
        self.pressure, self.time_ms, self.vacuum, self.timed = pressure, 100, 12, False
        self._dialect = dialect
        self._open_until = 0.0
        self.commands: list[bytes] = []
        self.misbehaviour = ""
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    @property
    def open(self) -> bool:
        """Whether its valve is open."""
        return time.monotonic() < self._open_until

    @property
    def starts(self) -> int:
        """Starts that it executed."""
        return self.commands.count(b"DI  ")

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
            byte = self._byte()
            while byte == ENQ and self.misbehaviour != "silent":
                os.write(self._end, ACK)
                data = b""
                while (byte := self._byte()) not in (b"", ENQ, EOT, ETX):
                    data += byte
                if byte == ETX:  # anything else ends what was begun, an ENQ begins anew
                    self._answer(data + ETX)

    def _answer(self, data: bytes) -> None:
        try:
            body = unframe(data)
        except LinkTimeout:
            os.write(self._end, frame(REJECTED))
            return
        answer = self._execute(body)
        verdict = frame(REJECTED if answer is None else ACCEPTED)
        lost = self.misbehaviour
        if lost == "lose_verdict" or (lost == "lose_start" and body == b"DI  "):
            self.misbehaviour = ""
            return
        if lost == "garble":
            self.misbehaviour = ""
            verdict = verdict[:3] + b"?" + verdict[4:]
        os.write(self._end, verdict)
        if answer and self._byte(0.3) == ACK:
            os.write(self._end, frame(answer))

    def _execute(self, body: bytes) -> bytes | None:
        """Execute a command; returns its answer, empty where it has none, None if rejected."""
        self.commands.append(body)
        return self._super_sigma(body) if self._dialect == "super_sigma" else self._ml_808gx(body)

    def _super_sigma(self, body: bytes) -> bytes | None:
        if body[:2] == b"UL" and body[5:] == b"D01":
            told = self.pressure, self.time_ms, self.vacuum, b"SE1700"
            return b"DA01P%04dT%05dV%04dM1N%-10s" % told
        if body[:5] == b"PR  P" and body[5:9].isdigit() and int(body[5:9]) <= HIGHEST:
            self.pressure, self.time_ms = int(body[5:9]), int(body[10:14])
            self.vacuum = int(body[16:20])
            return b""
        return None

    def _ml_808gx(self, body: bytes) -> bytes | None:
        if body[:2] == b"GC":
            return b"D0P%04dT%04dOD00000OF00000" % (self.pressure, self.time_ms)
        if body[:6] == b"PH  CH" and body[9:10] == b"P" and int(body[10:]) <= HIGHEST:
            self.pressure = int(body[10:])
        elif body[:6] == b"DH  CH" and body[9:10] == b"T" and int(body[10:]) >= 10:
            self.time_ms = int(body[10:])
        elif body == b"TT  ":
            self.timed = True
        elif body == b"DI  ":
            now = time.monotonic()
            shot = self.time_ms / 1e3 if self.timed else float("inf")
            self._open_until = 0.0 if self.open and not self.timed else now + shot
        else:
            return None
        return b""
