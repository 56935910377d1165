# SPDX-License-Identifier: Apache-2.0
"""Musashi pneumatic dispensers over RS-232C: parameters only, starting is a wired signal.

Framing and handshake are those of several published drivers; write commands of the newer
models are not confirmed, so that writing is off until a person enables it, and every write
is read back. The command that starts and stops dispensing is a toggle and is not sent at all.
"""

from __future__ import annotations

import contextlib
import threading
from dataclasses import dataclass
from typing import Any

from vega_planner.datatypes import Bools
from vega_planner.errors import DriverError, LinkTimeout, Refused
from vega_robot_driver.dispenser.base import Dispenser

STX, ETX, EOT, ENQ, ACK, CAN = (bytes([code]) for code in (2, 3, 4, 5, 6, 0x18))
ACCEPTED, REJECTED = b"A0", b"A2"
#: Tries of a transfer that may be repeated.
TRIES = 3
#: Pressures closer than this are the same: half of what the line can tell [Pa].
_SAME = 50.0


@dataclass(frozen=True)
class Dialect:
    """Commands of a family of dispensers.

    Attributes:
        name: Name of the family.
        read: Command that reads a channel's parameters; takes the channel.
        write_pressure: Command that sets the pressure; takes tenths of a kilopascal.
        pressure_at: Where the pressure lies in the answer, tenths of a kilopascal.
    """

    name: str
    read: str = "UL{channel:03d}D01"
    write_pressure: str = "PR  P{tenths:04d}T0000V-0000"
    pressure_at: tuple[int, int] = (5, 9)


#: Known families.
DIALECTS = {"super_sigma": Dialect("super_sigma")}


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


class MusashiDispenser(Dispenser):
    """A dispenser whose valve is wired and whose pressure is watched over a serial line.

    Args:
        port: Serial port.
        baud: Bits a second.
        channel: Channel whose parameters are used.
        dialect: Name of the family.
        writes: Whether the pressure may be set.
        timeout_s: Time an answer may take.
        watch_s: Time between two looks at the pressure; 0 for none.
    """

    def __init__(
        self,
        port: str,
        *,
        baud: int = 9600,
        channel: int = 1,
        dialect: str = "super_sigma",
        writes: bool = False,
        timeout_s: float = 0.2,
        watch_s: float = 0.25,
    ) -> None:
        if dialect not in DIALECTS:
            raise Refused(f"dialect '{dialect}' not known; has: {', '.join(DIALECTS)}")
        self._port, self._baud, self._channel = port, baud, channel
        self._dialect, self._writes, self._timeout = DIALECTS[dialect], writes, timeout_s
        self._line: Any = None
        self._pressure = self._wanted = 0.0
        self._watch_s, self._fault = watch_s, ""
        self._turn, self._closed = threading.Lock(), threading.Event()

    def open(self) -> None:
        """Connect, read the pressure, and keep watching it."""
        import serial

        try:
            self._line = serial.Serial(
                self._port, self._baud, timeout=self._timeout, write_timeout=self._timeout
            )
        except serial.SerialException as error:
            raise DriverError(f"dispenser: {error}") from error
        self._pressure = self.read_pressure()
        if self._wanted:
            self.set_pressure(self._wanted)
        if self._watch_s:
            threading.Thread(target=self._watch, name="dispenser", daemon=True).start()

    @property
    def fault(self) -> str:
        """Why the machine must stop: the line is dead, or the pressure changed."""
        return self._fault

    def _watch(self) -> None:
        """Read the pressure now and then; a line that is dead for all tries is a fault."""
        while not self._closed.wait(self._watch_s):
            try:
                found = self.read_pressure()
            except DriverError as error:
                if not self._closed.is_set():
                    self._fault = str(error)
                continue
            changed = abs(found - self._pressure) >= _SAME
            self._fault = (
                f"the dispenser's pressure went from {self._pressure / 1e3:g} kPa to "
                f"{found / 1e3:g} kPa"
                if changed
                else ""
            )

    def read_pressure(self) -> float:
        """Read the set pressure [Pa].

        Raises:
            LinkTimeout: If the dispenser does not answer.
        """
        with self._turn:
            return self._parsed(self._locked_transfer(self._reading, upload=True))

    @property
    def _reading(self) -> bytes:
        return self._dialect.read.format(channel=self._channel).encode()

    def _parsed(self, answer: bytes) -> float:
        try:
            return int(answer[slice(*self._dialect.pressure_at)]) * 100.0
        except ValueError as error:
            raise LinkTimeout(f"dispenser: unknown answer {answer!r}") from error

    def set_pressure(self, pressure_pa: float) -> None:
        """Set the pressure [Pa] and read it back.

        Raises:
            Refused: If writing is not enabled, the dispenser rejects it, or keeps another.
        """
        self._wanted = pressure_pa
        if self._line is None or abs(self._pressure - pressure_pa) < _SAME:
            return
        if not self._writes:
            raise Refused(
                f"the dispenser is set to {self._pressure / 1e3:g} kPa, the job wants "
                f"{pressure_pa / 1e3:g} kPa; set it by hand, or enable writing"
            )
        tenths = round(pressure_pa / 100.0)
        command = self._dialect.write_pressure.format(tenths=tenths).encode()
        with self._turn:
            self._locked_transfer(command)
            self._pressure = self._parsed(self._locked_transfer(self._reading, upload=True))
        if abs(self._pressure - pressure_pa) >= _SAME:
            raise Refused(f"the dispenser keeps {self._pressure / 1e3:g} kPa")

    def follow(self, gate: Bools, dt: float) -> float:
        """Tell the set pressure while the wired valve is open."""
        return self._pressure if len(gate) and gate[-1] else 0.0

    def close(self) -> None:
        """Leave the line."""
        self._closed.set()
        with self._turn:
            line, self._line = self._line, None
            if line is not None:
                line.close()

    def _locked_transfer(self, body: bytes, *, upload: bool = False) -> bytes:
        """Send a command that may be repeated; settings may, toggles may not."""
        import serial

        if self._line is None:
            raise LinkTimeout(f"dispenser on {self._port}: not connected")
        for left in reversed(range(TRIES)):
            try:
                return self._once(body, upload)
            except (LinkTimeout, serial.SerialException) as error:
                with contextlib.suppress(serial.SerialException):
                    self._line.write(EOT)
                if not left:
                    raise LinkTimeout(f"dispenser on {self._port}: {error}") from error
        raise AssertionError("unreachable")

    def _once(self, body: bytes, upload: bool) -> bytes:
        line = self._line
        line.reset_input_buffer()
        line.write(ENQ)
        if line.read(1) != ACK:
            raise LinkTimeout("no answer to ENQ")
        line.write(frame(body))
        verdict = unframe(line.read_until(ETX, 300))
        if verdict == REJECTED:
            line.write(STX + b"02" + CAN * 2 + b"6E" + ETX + EOT)
            raise Refused(f"the dispenser rejects {body.decode()!r}")
        if verdict != ACCEPTED:
            raise LinkTimeout(f"unexpected verdict {verdict!r}")
        answer = b""
        if upload:
            line.write(ACK)
            answer = unframe(line.read_until(ETX, 300))
        line.write(EOT)
        return answer
