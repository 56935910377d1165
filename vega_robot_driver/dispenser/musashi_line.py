# SPDX-License-Identifier: Apache-2.0
"""Frames and handshake of Musashi dispensers on a serial line (RS-232C).

Framing and handshake are those of several published drivers: STX, two digits of length, the
command, two digits of checksum, ETX; ENQ and ACK before, the verdict A0 or A2 after, EOT in
the end.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable
from typing import Any, TypeVar

from vega_planner.errors import DriverError, LinkTimeout, Refused

STX, ETX, EOT, ENQ, ACK, CAN = (bytes([code]) for code in (2, 3, 4, 5, 6, 0x18))
ACCEPTED, REJECTED = b"A0", b"A2"
#: Tries of a transfer that may be repeated.
TRIES = 3
_Answer = TypeVar("_Answer")


def checksum(data: bytes) -> bytes:
    """Two's complement of the sum of the bytes, as two hexadecimal digits."""
    return b"%02X" % (-sum(data) & 0xFF)


def frame(body: bytes) -> bytes:
    """Put a command between its length, its checksum and the control characters."""
    data = b"%02X" % len(body) + body
    return STX + data + checksum(data) + ETX


def unframe(data: bytes) -> bytes:
    """Take the body out of a frame.

    Raises:
        LinkTimeout: If the frame is short or damaged.
    """
    inner = data[1:-3]
    whole = data[:1] == STX and data[-1:] == ETX and len(inner) >= 2
    if not whole or checksum(inner) != data[-3:-1] or inner[:2] != b"%02X" % (len(inner) - 2):
        raise LinkTimeout(f"damaged answer of the dispenser: {data!r}")
    return inner[2:]


class MusashiLine:
    """A serial line to a dispenser; one transfer at a time.

    Args:
        port: Serial port.
        baud: Bits a second.
        timeout_s: Time an answer may take.

    Raises:
        DriverError: If the port cannot be opened.
    """

    def __init__(self, port: str, baud: int, timeout_s: float) -> None:
        import termios

        import serial

        # Of a line that hangs up, pyserial passes on what the terminal says.
        self._port, self._errors = port, (serial.SerialException, termios.error)
        self._turn = threading.Lock()
        try:
            self._serial: Any = serial.Serial(
                port, baud, timeout=timeout_s, write_timeout=timeout_s
            )
        except serial.SerialException as error:
            raise DriverError(f"dispenser: {error}") from error

    def close(self) -> None:
        """Leave the line; safe to call twice."""
        with self._turn:
            line, self._serial = self._serial, None
            if line is not None:
                line.close()

    def read(
        self, command: str, parsed: Callable[[bytes], _Answer], tries: int = TRIES
    ) -> _Answer:
        """Send a command that has an answer; it is repeated where that is not understood.

        Args:
            command: The command.
            parsed: Reads the answer; raises `LinkTimeout` where it is none.
            tries: How often it is tried.

        Raises:
            LinkTimeout: If the dispenser does not answer.
            Refused: If it rejects the command.
        """
        return self._transfer(command, parsed, tries)

    def write(self, command: str) -> None:
        """Send a command that says what is to be; it is repeated like a reading."""
        self._transfer(command, None, TRIES)

    def send_once(self, command: str) -> None:
        """Send a command that must not come twice.

        Raises:
            LinkTimeout: If its verdict is lost: it may have been executed or not.
            Refused: If the dispenser rejects it.
        """
        self._transfer(command, None, 1)

    def _transfer(self, command: str, parsed: Callable[[bytes], Any] | None, tries: int) -> Any:
        with self._turn:
            if self._serial is None:
                raise LinkTimeout(f"dispenser on {self._port}: not connected")
            for left in reversed(range(tries)):
                try:
                    return self._once(command.encode(), parsed)
                except (LinkTimeout, *self._errors) as error:
                    with contextlib.suppress(*self._errors):
                        self._serial.write(EOT)
                    if not left:
                        raise LinkTimeout(f"dispenser on {self._port}: {error}") from error
        raise AssertionError("unreachable")

    def _once(self, body: bytes, parsed: Callable[[bytes], Any] | None) -> Any:
        line = self._serial
        line.reset_input_buffer()
        line.write(ENQ)
        if line.read(1) != ACK:
            raise LinkTimeout("no answer to ENQ")
        line.write(frame(body))
        verdict = unframe(self._frame())
        if verdict == REJECTED:
            line.write(STX + b"02" + CAN * 2 + b"6E" + ETX + EOT)
            raise Refused(f"the dispenser rejects {body.decode()!r}")
        if verdict != ACCEPTED:
            raise LinkTimeout(f"unexpected verdict {verdict!r}")
        answer = None
        if parsed is not None:
            line.write(ACK)
            answer = parsed(unframe(self._frame()))
        line.write(EOT)
        return answer

    def _frame(self) -> bytes:
        """Read up to the end of a frame; what came late of a try before stands before it."""
        data: bytes = self._serial.read_until(ETX, 300)
        return data[max(data.rfind(STX), 0) :]
