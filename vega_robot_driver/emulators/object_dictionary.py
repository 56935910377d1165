# SPDX-License-Identifier: Apache-2.0
"""An object dictionary of typed entries, as a CANopen-over-EtherCAT slave keeps it."""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, field

#: Reasons of a refused transfer (ETG.1000.6, table 41).
NO_OBJECT, NO_SUBINDEX, READ_ONLY = 0x06020000, 0x06090011, 0x06010002
TOO_LONG, TOO_SHORT, WRONG_STATE = 0x06070012, 0x06070013, 0x08000022
BAD_COMMAND, BAD_TOGGLE = 0x05040001, 0x05030000


class Abort(Exception):
    """A transfer is refused; carries the reason's code."""

    def __init__(self, code: int) -> None:
        super().__init__(f"0x{code:08X}")
        self.code = code


@dataclass(slots=True)
class Entry:
    """One value: its `struct` format without byte order, and whether masters may write it."""

    form: str
    value: int
    writable: bool = True

    @property
    def size(self) -> int:
        """Size in bytes."""
        return struct.calcsize(self.form)

    def packed(self) -> bytes:
        """The value in the bytes of the wire."""
        return struct.pack("<" + self.form, self.value)


@dataclass
class ObjectDictionary:
    """Entries by index and subindex.

    Attributes:
        entries: The entries.
        before_write: Called with index, subindex and value; may raise `Abort`.
    """

    entries: dict[tuple[int, int], Entry] = field(default_factory=dict)
    before_write: Callable[[int, int, int], None] | None = None

    def add(
        self, index: int, form: str, value: int = 0, *, sub: int = 0, writable: bool = True
    ) -> None:
        """Add an entry."""
        self.entries[index, sub] = Entry(form, value, writable)

    def add_list(self, index: int, form: str, values: list[int], room: int = 0) -> None:
        """Add a list: its count at subindex 0, the values from 1, and room for more."""
        self.add(index, "B", len(values))
        for sub in range(1, max(room, len(values)) + 1):
            self.add(index, form, values[sub - 1] if sub <= len(values) else 0, sub=sub)

    def entry(self, index: int, sub: int = 0) -> Entry:
        """Find an entry.

        Raises:
            Abort: If it does not exist.
        """
        found = self.entries.get((index, sub))
        if found is None:
            raise Abort(NO_SUBINDEX if (index, 0) in self.entries else NO_OBJECT)
        return found

    def __getitem__(self, index: int) -> int:
        return self.entries[index, 0].value

    def __setitem__(self, index: int, value: int) -> None:
        self.entries[index, 0].value = value

    def write(self, index: int, sub: int, data: bytes) -> None:
        """Write an entry from the bytes of the wire.

        Raises:
            Abort: If it is refused.
        """
        entry = self.entry(index, sub)
        if not entry.writable:
            raise Abort(READ_ONLY)
        if len(data) != entry.size:
            raise Abort(TOO_LONG if len(data) > entry.size else TOO_SHORT)
        value = struct.unpack("<" + entry.form, data)[0]
        if self.before_write:
            self.before_write(index, sub, value)
        entry.value = value

    def mapping(self, assignment: int) -> list[Entry | int]:
        """List the entries that a PDO assignment maps, gaps as their size in bytes."""
        found: list[Entry | int] = []
        for number in range(1, self[assignment] + 1):
            pdo = self.entry(assignment, number).value
            for item in range(1, self[pdo] + 1):
                word = self.entry(pdo, item).value
                if word >> 16:
                    found.append(self.entry(word >> 16, (word >> 8) & 0xFF))
                else:
                    found.append((word & 0xFF) // 8)
        return found
