# SPDX-License-Identifier: Apache-2.0
"""The mailbox of an EtherCAT slave: SDO transfers and emergencies (ETG.1000.6, 5.6)."""

from __future__ import annotations

import struct

from vega_robot_driver.emulators.object_dictionary import (
    BAD_COMMAND,
    Abort,
    ObjectDictionary,
)

_COE = 3
_EMERGENCY, _REQUEST, _RESPONSE = 1, 2, 3


class Mailbox:
    """Answers requests for an object dictionary, one value at a time.

    Args:
        dictionary: What can be read and written.
    """

    def __init__(self, dictionary: ObjectDictionary) -> None:
        self._dictionary = dictionary
        self._counter = 0

    def emergency(self, code: int, register: int) -> bytes:
        """Make an emergency message."""
        return self._wrapped(_EMERGENCY, struct.pack("<HB5x", code, register))

    def answer(self, message: bytes) -> bytes:
        """Answer a request."""
        length, _, _, kind = struct.unpack_from("<HHBB", message)
        body = message[6 : 6 + length]
        if kind & 0x0F != _COE or len(body) < 10 or struct.unpack_from("<H", body)[0] >> 12 != 2:
            return struct.pack("<HHBBHH", 4, 0, 0, 0x10, 1, 0x02)  # protocol not supported
        command, index, sub = struct.unpack_from("<BHB", body, 2)
        try:
            return self._transfer(command, index, sub, body[6:])
        except Abort as refusal:
            return self._wrapped(_REQUEST, struct.pack("<BHBI", 0x80, index, sub, refusal.code))

    def _transfer(self, command: int, index: int, sub: int, data: bytes) -> bytes:
        kind, complete = command >> 5, command & 0x10
        if kind == 2 and not complete:  # upload
            value = self._dictionary.entry(index, sub).packed()
            head = struct.pack("<BHB", 0x43 | (4 - len(value)) << 2, index, sub)
            return self._wrapped(_RESPONSE, head + value.ljust(4, b"\0"))
        if kind == 1 and not complete:  # download
            if command & 2:
                size = 4 - (command >> 2 & 3) if command & 1 else 4
                value = data[:size]
            else:
                value = data[4 : 4 + struct.unpack_from("<I", data)[0]]
            self._dictionary.write(index, sub, value)
            return self._wrapped(_RESPONSE, struct.pack("<BHBI", 0x60, index, sub, 0))
        raise Abort(BAD_COMMAND)

    def _wrapped(self, service: int, payload: bytes) -> bytes:
        self._counter = self._counter % 7 + 1
        body = struct.pack("<H", service << 12) + payload
        return struct.pack("<HHBB", len(body), 0, 0, self._counter << 4 | _COE) + body
