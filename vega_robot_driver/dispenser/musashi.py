# SPDX-License-Identifier: Apache-2.0
"""Musashi pneumatic dispensers over RS-232C.

The line is for parameters; starting and stopping is a wired signal. Writing is off until a
person enables it, and every write is read back. Where a dispenser's start cannot be wired, its
shots may be started over the line (`shot_s`): in timed mode, so that it stops by itself
whatever becomes of the line, and never twice for one wish.
"""

from __future__ import annotations

import threading
import time
from dataclasses import replace

from vega_planner.datatypes import Bools
from vega_planner.errors import DriverError, LinkTimeout, Refused
from vega_robot_driver.dispenser.base import Dispenser
from vega_robot_driver.dispenser.dialects import Parameters, dialect_of
from vega_robot_driver.dispenser.musashi_line import TRIES, MusashiLine

#: Pressures closer than this are the same: half of what the line can tell [Pa].
_SAME = 50.0
#: Tries of the first reading: nothing hurries yet.
_TRIES_AT_FIRST = 10
#: Longest shot that the commands have digits for [ms].
_LONGEST_SHOT = 9999


class MusashiDispenser(Dispenser):
    """A dispenser whose pressure is watched over a serial line.

    Args:
        port: Serial port.
        baud: Bits a second.
        channel: Channel whose parameters are used.
        dialect: Name of the family.
        writes: Whether parameters may be set.
        shot_s: Time of a shot where the line starts them [s]; 0 where a wire does.
        timeout_s: Time an answer may take.
        watch_s: Time between two looks at the pressure; 0 for none.

    Raises:
        Refused: If the family is not known, or shots cannot be started over the line.
    """

    def __init__(
        self,
        port: str,
        *,
        baud: int = 9600,
        channel: int = 1,
        dialect: str = "super_sigma",
        writes: bool = False,
        shot_s: float = 0.0,
        timeout_s: float = 0.1,
        watch_s: float = 0.1,
    ) -> None:
        self._dialect = dialect_of(dialect)
        if shot_s and not (self._dialect.start and writes):
            reason = "'writes' is off" if self._dialect.start else "its start is not published"
            raise Refused(f"shots of a '{dialect}' cannot be started over the line: {reason}")
        self._port, self._baud, self._channel = port, baud, channel
        self._writes, self._timeout, self._watch_s = writes, timeout_s, watch_s
        self._line: MusashiLine | None = None
        self._set = Parameters(0, 0)
        self._wanted, self._fault, self._shot_s = 0.0, "", shot_s
        self._open, self._closed = threading.Event(), threading.Event()

    def open(self) -> None:
        """Connect, read the pressure, and keep watching it."""
        self._line = MusashiLine(self._port, self._baud, self._timeout)
        self._set = self._read(_TRIES_AT_FIRST)
        if self._wanted:
            self.set_pressure(self._wanted)
        if self._shot_s:
            self._line.write(self._dialect.timed_mode)
            self._write(self._dialect.write_time, time_ms=round(1e3 * self._shot_s))
            threading.Thread(target=self._shoot, name="shots", daemon=True).start()
        if self._watch_s:
            threading.Thread(target=self._watch, name="dispenser", daemon=True).start()

    @property
    def fault(self) -> str:
        """Why the machine must stop: the line is dead, or the pressure changed."""
        return self._fault

    def reset_fault(self) -> None:
        """Forget a fault; what still is one is noticed again."""
        self._fault = ""

    def read_pressure(self) -> float:
        """Read the set pressure [Pa].

        Raises:
            LinkTimeout: If the dispenser does not answer.
        """
        return self._read().pressure_pa

    def set_pressure(self, pressure_pa: float) -> None:
        """Set the pressure [Pa] and read it back.

        Raises:
            Refused: If writing is not enabled, the dispenser rejects it, or keeps another.
        """
        self._wanted = pressure_pa
        if self._line is None:
            return
        self._set = self._read()
        if abs(self._set.pressure_pa - pressure_pa) < _SAME:
            return
        if not self._writes:
            raise Refused(
                f"the dispenser is set to {self._set.pressure_pa / 1e3:g} kPa, the job wants "
                f"{pressure_pa / 1e3:g} kPa; set it by hand, or enable writing"
            )
        self._write(self._dialect.write_pressure, tenths=round(pressure_pa / 100.0))

    def follow(self, gate: Bools, dt: float) -> float:
        """Tell the set pressure while the valve is open; where the line starts shots, do so."""
        on = bool(len(gate) and gate[-1])
        if self._shot_s and on != self._open.is_set():
            self._open.set() if on else self._open.clear()
        return self._set.pressure_pa if on else 0.0

    def close(self) -> None:
        """Leave the line."""
        self._open.clear()
        self._closed.set()
        line, self._line = self._line, None
        if line is not None:
            line.close()

    def _read(self, tries: int = TRIES) -> Parameters:
        if self._line is None:
            raise LinkTimeout(f"dispenser on {self._port}: not connected")
        command = self._dialect.read.format(channel=self._channel)
        return self._line.read(command, self._dialect.parsed, tries)

    def _write(self, template: str, **changed: int) -> None:
        """Change a parameter, and see that this and no other has changed."""
        wanted = replace(self._set, **changed)
        if wanted.time_ms > _LONGEST_SHOT:
            raise Refused(f"a shot of {wanted.time_ms} ms; at most {_LONGEST_SHOT} can be written")
        command = template.format(channel=self._channel, **vars(wanted))
        assert self._line is not None
        self._line.write(command)
        self._set = self._read()
        if self._set != wanted:
            raise Refused(f"after {command!r} the dispenser keeps {self._set}; wanted {wanted}")

    def _watch(self) -> None:
        """Read the pressure now and then; a line that is dead for all tries is a fault."""
        while not self._closed.wait(self._watch_s):
            before = self._set
            try:
                found = self._read().pressure_pa
            except DriverError as error:
                self._fail(str(error))
                continue
            if abs(found - before.pressure_pa) >= _SAME and before == self._set:
                self._fail(
                    f"the dispenser's pressure went from {before.pressure_pa / 1e3:g} kPa to "
                    f"{found / 1e3:g} kPa"
                )

    def _shoot(self) -> None:
        """Start shot after shot while the valve is to be open.

        A start whose verdict is lost may have been executed: it is not repeated, the machine
        stops, and a shot that runs ends by itself.
        """
        while not self._closed.is_set():
            if not self._open.wait(0.1) or self._fault:
                continue
            line, began = self._line, time.monotonic()
            try:
                if line is not None:
                    line.send_once(self._dialect.start)
            except DriverError as error:
                self._fail(
                    f"a shot was not confirmed: {error}; if it runs it ends within "
                    f"{self._shot_s:g} s"
                )
                continue
            self._closed.wait(max(began + self._shot_s - time.monotonic(), 0.0))

    def _fail(self, reason: str) -> None:
        if not self._closed.is_set() and not self._fault:
            self._fault = reason
