# SPDX-License-Identifier: Apache-2.0
"""Commands of Musashi dispensers by family: what is published, and nothing that is not.

What a family's public documents and drivers do not tell is left empty here, and then refused
with a line that says so.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from vega_planner.errors import LinkTimeout, Refused


@dataclass(frozen=True)
class Parameters:
    """What a channel is set to.

    Attributes:
        tenths: Pressure [0.1 kPa].
        time_ms: Time of a shot in timed mode [ms].
        vacuum: Vacuum against dripping [0.01 kPa]; 0 where the family does not tell.
    """

    tenths: int
    time_ms: int
    vacuum: int = 0

    @property
    def pressure_pa(self) -> float:
        """Pressure [Pa]."""
        return self.tenths * 100.0


@dataclass(frozen=True)
class Dialect:
    """Commands of a family. Templates take `channel`, and the fields of `Parameters`.

    Attributes:
        name: Name of the family.
        read: Reads a channel.
        answer: Finds the fields of `Parameters` in the answer.
        write_pressure: Sets the pressure; may set other fields too, to what they are.
        write_time: Sets the time of a shot, or empty where that is not published.
        timed_mode: Makes every start a shot of that time, or empty.
        start: Starts a shot in timed mode and toggles in steady mode, so that it is never
            sent twice; empty where that is not published.
    """

    name: str
    read: str
    answer: re.Pattern[bytes]
    write_pressure: str
    write_time: str = ""
    timed_mode: str = ""
    start: str = ""

    def parsed(self, answer: bytes) -> Parameters:
        """Read a channel's parameters out of an answer.

        Raises:
            LinkTimeout: If it is not one.
        """
        found = self.answer.search(answer)
        if found is None:
            raise LinkTimeout(f"dispenser: unknown answer {answer!r}")
        return Parameters(**{name: int(digits) for name, digits in found.groupdict().items()})


#: Known families. Super Sigma CM II: a published reader, after its manual; the start command
#: is not published. ML-808GX and 808FX: three published drivers.
DIALECTS = {
    dialect.name: dialect
    for dialect in (
        Dialect(
            "super_sigma",
            read="UL{channel:03d}D01",
            answer=re.compile(rb"^DA01P(?P<tenths>\d{4})T(?P<time_ms>\d{5})V(?P<vacuum>\d{4})"),
            write_pressure="PR  P{tenths:04d}T{time_ms:04d}V-{vacuum:04d}",
        ),
        Dialect(
            "ml_808gx",
            read="GC{channel:03d}",
            answer=re.compile(rb"P(?P<tenths>\d{4})T(?P<time_ms>\d{4})"),
            write_pressure="PH  CH{channel:03d}P{tenths:04d}",
            write_time="DH  CH{channel:03d}T{time_ms:04d}",
            timed_mode="TT  ",
            start="DI  ",
        ),
    )
}


def dialect_of(name: str) -> Dialect:
    """Find a family by its name.

    Raises:
        Refused: If it is not known.
    """
    if name not in DIALECTS:
        raise Refused(f"dialect '{name}' not known; has: {', '.join(DIALECTS)}")
    return DIALECTS[name]
