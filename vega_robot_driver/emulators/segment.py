# SPDX-License-Identifier: Apache-2.0
"""A line of emulated slaves: takes an Ethernet frame, returns it as it comes back."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from vega_robot_driver.emulators.slave_controller import SlaveController

ETHERTYPE = b"\x88\xa4"
(_NOP, APRD, APWR, APRW, FPRD, FPWR, FPRW, BRD, BWR, BRW, LRD, LWR, LRW, ARMW, FRMW) = range(15)
#: Time a frame takes from one slave to the next [ns].
HOP_NS = 600


@dataclass
class Segment:
    """A daisy chain.

    Attributes:
        slaves: The slaves in their order on the line.
        plugged: How many of them the cable still reaches.
        frames_to_lose: So many of the next frames are lost.
        counters_to_falsify: So many of the next cyclic frames come back one too low.
        cycles: Cyclic frames seen.
    """

    slaves: list[SlaveController]
    plugged: int = 99
    frames_to_lose: int = 0
    counters_to_falsify: int = 0
    cycles: int = 0

    def tick(self, now: float, dt: float) -> None:
        """Let time pass [s]."""
        for slave in self.slaves:
            slave.tick(now, dt)

    def process(self, frame: bytes) -> bytes | None:
        """Send a frame down the line and back; None where it is lost or not EtherCAT."""
        if len(frame) < 16 or frame[12:14] != ETHERTYPE:
            return None
        if self.frames_to_lose > 0:
            self.frames_to_lose -= 1
            self.cycles += frame[16] == LRW  # its time passes all the same
            return None
        data = bytearray(frame)
        data[6] |= 2  # a slave marks the source address as locally administered
        end = 16 + (struct.unpack_from("<H", data, 14)[0] & 0x7FF)
        at = 16
        while at + 12 <= end:
            size = struct.unpack_from("<H", data, at + 6)[0] & 0x7FF
            counted = self._datagram(data, at, size)
            old = struct.unpack_from("<H", data, at + 10 + size)[0]
            struct.pack_into("<H", data, at + 10 + size, (old + counted) & 0xFFFF)
            at += 12 + size
        return bytes(data)

    def _datagram(self, data: bytearray, at: int, size: int) -> int:
        command = data[at]
        position, address = struct.unpack_from("<HH", data, at + 2)
        area = slice(at + 10, at + 10 + size)
        slaves = self.slaves[: self.plugged]
        if command in (LRD, LWR, LRW):
            content = bytearray(data[area])
            logical = position | address << 16
            reads, writes = command != LWR, command != LRD
            counted = sum([slave.logical(logical, content, reads, writes) for slave in slaves])
            data[area] = content
            self.cycles += command == LRW
            if command == LRW and self.counters_to_falsify > 0:
                self.counters_to_falsify -= 1
                counted -= 1
            return counted
        if command in (ARMW, FRMW):
            return self._spread(data, at, size, slaves)
        if command not in range(APRD, LRD):
            return 0
        if command == BWR and address == 0x900:
            self._latch(slaves)
        reads = command in (APRD, APRW, FPRD, FPRW, BRD, BRW)
        writes = command in (APWR, APRW, FPWR, FPRW, BWR, BRW)
        counted = 0
        for place, slave in enumerate(slaves):
            if command in (APRD, APWR, APRW) and (position + place) & 0xFFFF:
                continue
            if command in (FPRD, FPWR, FPRW) and position != slave.station:
                continue
            self._link_status(slave, place, len(slaves))
            sent = bytes(data[area])
            if reads:
                found = slave.read(address, size)
                if found is not None:
                    broadcast = command in (BRD, BRW)
                    merged = bytes(a | b for a, b in zip(sent, found)) if broadcast else found
                    data[area] = merged
                    counted += 1
            if writes and slave.write(address, sent):
                counted += 2 if reads else 1
        if command in (APRD, APWR, APRW, BRD, BWR, BRW):
            struct.pack_into("<H", data, at + 2, (position + len(slaves)) & 0xFFFF)
        return counted

    @staticmethod
    def _spread(data: bytearray, at: int, size: int, slaves: list[SlaveController]) -> int:
        """Read one slave's register and write it to those behind it: the clocks' time."""
        command = data[at]
        position, address = struct.unpack_from("<HH", data, at + 2)
        area, counted = slice(at + 10, at + 10 + size), 0
        for place, slave in enumerate(slaves):
            mine = (
                (position + place) & 0xFFFF == 0 if command == ARMW else position == slave.station
            )
            if mine and (found := slave.read(address, size)) is not None:
                data[area] = found
            elif not mine:
                slave.write(address, bytes(data[area]))
            counted += 1
        return counted

    @staticmethod
    def _latch(slaves: list[SlaveController]) -> None:
        """Let each slave note when a frame passed it on its way out and back."""
        last = len(slaves) - 1
        for place, slave in enumerate(slaves):
            out = slave.local_time + HOP_NS * place
            slave.latch_receive_times((out, out + 2 * HOP_NS * (last - place)))

    @staticmethod
    def _link_status(slave: SlaveController, place: int, count: int) -> None:
        """Show which ports have a neighbour."""
        last = place == count - 1
        word = 0x5000 | 0x0200 | (0x0400 if last else 0x0800) | 0x10 | (0 if last else 0x20) | 1
        struct.pack_into("<H", slave.memory, 0x110, word)
