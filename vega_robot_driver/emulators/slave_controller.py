# SPDX-License-Identifier: Apache-2.0
"""An emulated EtherCAT slave controller: registers, states, EEPROM, mailbox, FMMUs, watchdog.

After ETG.1000.4 and ETG.1000.6. Byte-aligned FMMUs only; no file or Ethernet transfer, and no
redundancy. Distributed clocks are registers that show the emulation's time, and the counter
of missed cycles (object 10F1, ETG.1020): the clocks have no drift of their own.
"""

from __future__ import annotations

import struct

from vega_robot_driver.emulators.cia402_drive import Cia402Drive
from vega_robot_driver.emulators.mailbox import Mailbox

INIT, PREOP, SAFEOP, OP = 1, 2, 4, 8
MAILBOX_SIZE = 256
MAILBOX_OUT, MAILBOX_IN, DATA_OUT, DATA_IN = 0x1000, 0x1100, 0x1200, 0x1300
#: AL status codes.
BAD_CHANGE, UNKNOWN_STATE, BAD_MAILBOX = 0x0011, 0x0012, 0x0016
WATCHDOG, BAD_OUTPUTS, BAD_INPUTS, OUT_OF_SYNC = 0x001B, 0x001D, 0x001E, 0x001A
#: What a missed cycle adds to the counter of object 10F1, and what a good one takes off.
MISSED, GOOD = 3, 1

#: What a window has of a frame: offset there, address here, bytes, the window's, its kind.
_Share = tuple[int, int, int, int, int]
_WORD = struct.Struct("<H").unpack_from
_MAILBOX_FULL = 0x08
_IN_STATUS = 0x80D


class SlaveController:
    """What the wire sees of a drive.

    Args:
        drive: The drive behind it.
        name: Name in the EEPROM.
        alias: Station alias in the EEPROM.
    """

    def __init__(self, drive: Cia402Drive, name: str, alias: int = 0) -> None:
        self.drive, self.alias = drive, alias
        self.state = INIT
        self.memory = bytearray(0x2000)
        self._eeprom = eeprom_image(drive.identity, name, alias)
        self._mailbox = Mailbox(drive.objects)
        self._waiting: list[bytes] = []
        self._windows: list[tuple[int, int, int, int]] = []
        self._shares: dict[tuple[int, int], list[_Share]] = {}
        self._outputs = (0, 0)
        self._inputs = (0, 0)
        self._op_wanted = False
        self._now = self._fed = 0.0
        self._missed = self._sync_errors = 0
        memory = self.memory
        memory[0x00:0x0A] = bytes([0x11, 0, 2, 0, 8, 8, 8, 0x0F, 0x0C, 0])  # with 64 bit clock
        memory[0x130] = INIT
        memory[0x140] = 0x05
        struct.pack_into("<H", memory, 0x12, alias)
        struct.pack_into("<H", memory, 0x400, 0x09C2)
        struct.pack_into("<H", memory, 0x420, 1000)

    # -- datagrams ------------------------------------------------------------------------

    @property
    def station(self) -> int:
        """Configured station address."""
        return int.from_bytes(self.memory[0x10:0x12], "little")

    def read(self, address: int, size: int) -> bytes | None:
        """Read registers or memory; None where the mailbox is empty."""
        memory = self.memory
        if MAILBOX_IN <= address < MAILBOX_IN + MAILBOX_SIZE and memory[0x80E] & 1:
            if not memory[_IN_STATUS] & _MAILBOX_FULL:
                return None
            data = bytes(memory[address : address + size])
            if address + size >= MAILBOX_IN + MAILBOX_SIZE:
                memory[_IN_STATUS] &= ~_MAILBOX_FULL
                self._next_message()
            return data
        if address <= 0x910 < address + size:
            offset = int.from_bytes(memory[0x920:0x928], "little")
            shown = (self.local_time + offset) & (1 << 64) - 1
            memory[0x910:0x918] = shown.to_bytes(8, "little")
        return bytes(memory[address : address + size])

    @property
    def local_time(self) -> int:
        """The slave's own clock [ns]."""
        return round(self._now * 1e9)

    def latch_receive_times(self, ports: tuple[int, int]) -> None:
        """Note when a frame passed the two ports [ns of the local clock]."""
        memory = self.memory
        for at, port in ((0x900, ports[0]), (0x904, ports[1])):
            struct.pack_into("<I", memory, at, port & 0xFFFFFFFF)
        struct.pack_into("<Q", memory, 0x918, ports[0])

    def write(self, address: int, data: bytes) -> bool:
        """Write registers or memory; false where it is refused."""
        memory, size = self.memory, len(data)
        if MAILBOX_OUT <= address < MAILBOX_OUT + MAILBOX_SIZE and memory[0x806] & 1:
            memory[address : address + size] = data
            if address + size >= MAILBOX_OUT + MAILBOX_SIZE:
                message = bytes(memory[MAILBOX_OUT : MAILBOX_OUT + MAILBOX_SIZE])
                self._waiting.append(self._mailbox.answer(message))
                self._next_message()
        elif address == 0x120:
            memory[0x120] = data[0]
            self._request_state(data[0])
        elif address in (0x502, 0x504):
            memory[address : address + size] = data
            self._read_eeprom()
        elif 0x600 <= address < 0x700:
            memory[address : address + size] = data
            self._compile_windows()
        elif 0x800 <= address < 0x840:
            self._configure_managers(address, data)
        elif address >= 0x10 and address not in (0x110, 0x130, 0x134, 0x900, 0x910):
            memory[address : address + size] = data
        return True

    def logical(self, address: int, data: bytearray, reads: bool, writes: bool) -> int:
        """Exchange process data; returns what to add to the working counter."""
        shares = self._shares.get((address, len(data)))
        if shares is None:
            shares = self._shares[address, len(data)] = self._shared(address, len(data))
        counted, cyclic = 0, self.state in (SAFEOP, OP)
        for here, there, count, place, kind in shares:
            if kind & 1 and reads:
                if place == _IN_STATUS:
                    data[here] = self.memory[_IN_STATUS]
                    counted |= 1
                elif cyclic:
                    if place == self._inputs[0]:
                        self._refresh_inputs()
                    data[here : here + count] = self.memory[there : there + count]
                    counted |= 1
            if kind & 2 and writes and cyclic:
                self.memory[there : there + count] = data[here : here + count]
                if there + count >= self._outputs[0] + self._outputs[1]:
                    self._take_outputs()
                counted |= 2
        return counted if reads and writes else bool(counted)

    def _shared(self, address: int, size: int) -> list[_Share]:
        """Find what the windows have of a stretch of logical addresses."""
        shares: list[_Share] = []
        for start, length, place, kind in self._windows:
            low, high = max(start, address), min(start + length, address + size)
            if low < high:
                shares.append((low - address, place + low - start, high - low, place, kind))
        return shares

    def tick(self, now: float, dt: float) -> None:
        """Let time pass."""
        self._now = now
        self.drive.pass_time(dt)
        if self.state == OP:
            divider, count = _WORD(self.memory, 0x400)[0], _WORD(self.memory, 0x420)[0]
            limit = (divider + 2) * 40e-9 * count
            if limit and now - self._fed > limit:
                self._enter(SAFEOP, WATCHDOG)
            elif self.memory[0x981] & 1 and self._out_of_sync(now):
                self._enter(SAFEOP, OUT_OF_SYNC)
        while self.drive.emergencies:
            code, register = self.drive.emergencies.pop(0)
            if self.state >= PREOP:
                self._waiting.append(self._mailbox.emergency(code, register))
                self._next_message()

    def _out_of_sync(self, now: float) -> bool:
        """Count missed cycles, where the clocks are in use and a limit is set."""
        limit = self.drive.objects.entry(0x10F1, 2).value
        cycle = struct.unpack_from("<I", self.memory, 0x9A0)[0] * 1e-9
        if not limit or not cycle:
            return False
        missed = int((now - self._fed) / cycle - 0.25)
        self._sync_errors += MISSED * max(missed - self._missed, 0)
        self._missed = missed
        return self._sync_errors > limit

    # -- states ---------------------------------------------------------------------------

    def _enter(self, state: int, code: int = 0) -> None:
        if self.state == OP and state != OP:
            self.drive.lose_master()
        self.state = self.drive.bus_state = state
        self.memory[0x130] = state | (0x10 if code else 0)
        struct.pack_into("<H", self.memory, 0x134, code)
        self._sync_errors = self._missed = 0
        if state == INIT:
            self.memory[0x981] = 0
            self._waiting.clear()
            self.memory[_IN_STATUS] &= ~_MAILBOX_FULL

    def _request_state(self, word: int) -> None:
        wanted, current = word & 0x0F, self.state
        if self.memory[0x130] & 0x10 and not word & 0x10 and wanted > INIT and wanted >= current:
            return  # an error has to be acknowledged first
        if wanted == current:
            self._enter(current)
        elif wanted == INIT:
            self._enter(INIT)
        elif wanted == PREOP:
            good = current != INIT or self._managers_fit()
            self._enter(*((PREOP, 0) if good else (INIT, BAD_MAILBOX)))
        elif wanted == SAFEOP and current == PREOP:
            self._to_safe_operational()
        elif wanted == SAFEOP and current == OP:
            self._enter(SAFEOP)
        elif wanted == OP and current == SAFEOP:
            self._op_wanted = True  # entered with the first outputs
        else:
            known = wanted in (SAFEOP, OP)
            self._enter(current, BAD_CHANGE if known else UNKNOWN_STATE)

    def _manager(self, number: int) -> tuple[int, int, bool]:
        address, size, _, _, active = struct.unpack_from("<HHBBB", self.memory, 0x800 + 8 * number)
        return address, size, bool(active & 1)

    def _managers_fit(self) -> bool:
        wanted = (MAILBOX_OUT, MAILBOX_SIZE, True), (MAILBOX_IN, MAILBOX_SIZE, True)
        return (self._manager(0), self._manager(1)) == wanted

    def _to_safe_operational(self) -> None:
        received, sent = self.drive.compile_mapping()
        out_address, out_size, _ = self._manager(2)
        in_address, in_size, _ = self._manager(3)
        if out_size != received:
            return self._enter(PREOP, BAD_OUTPUTS)
        if in_size != sent:
            return self._enter(PREOP, BAD_INPUTS)
        self._outputs, self._inputs = (out_address, out_size), (in_address, in_size)
        self._op_wanted = False
        self._refresh_inputs()
        return self._enter(SAFEOP)

    def _take_outputs(self) -> None:
        if self._op_wanted:
            self._op_wanted = False
            self._enter(OP)
        if self.state == OP:
            self._fed = self._now
            self._missed = 0
            self._sync_errors = max(self._sync_errors - GOOD, 0)
            at, size = self._outputs
            self.drive.take_outputs(bytes(self.memory[at : at + size]))

    def _refresh_inputs(self) -> None:
        at, size = self._inputs
        self.memory[at : at + size] = self.drive.give_inputs()

    # -- registers ------------------------------------------------------------------------

    def _configure_managers(self, address: int, data: bytes) -> None:
        memory = self.memory
        status = [memory[0x805 + 8 * number] for number in range(8)]
        memory[address : address + len(data)] = data
        for number in range(8):
            active = memory[0x806 + 8 * number] & 1
            memory[0x805 + 8 * number] = status[number] if active else 0
            repeat = memory[0x806 + 8 * number] & 2
            memory[0x807 + 8 * number] = memory[0x807 + 8 * number] & ~2 | repeat

    def _compile_windows(self) -> None:
        self._windows, self._shares = [], {}
        for number in range(8):
            start, size, _, _, place, _, kind, active = struct.unpack_from(
                "<IHBBHBBB", self.memory, 0x600 + 16 * number
            )
            if active & 1 and size:
                self._windows.append((start, size, place, kind))

    def _read_eeprom(self) -> None:
        control = struct.unpack_from("<H", self.memory, 0x502)[0]
        if control & 0x0700 == 0x0100:
            at = 2 * struct.unpack_from("<I", self.memory, 0x504)[0]
            self.memory[0x508:0x510] = self._eeprom[at : at + 8].ljust(8, b"\xff")
        struct.pack_into("<H", self.memory, 0x502, control & 1 | 0x40)  # idle, 8 bytes a read

    def _next_message(self) -> None:
        if self._waiting and not self.memory[_IN_STATUS] & _MAILBOX_FULL:
            message = self._waiting.pop(0).ljust(MAILBOX_SIZE, b"\0")
            self.memory[MAILBOX_IN : MAILBOX_IN + MAILBOX_SIZE] = message
            self.memory[_IN_STATUS] |= _MAILBOX_FULL


def eeprom_image(identity: tuple[int, int, int, int], name: str, alias: int = 0) -> bytes:
    """Build the slave information that a master reads first (ETG.1000.6, 5.4).

    Args:
        identity: Vendor, product, revision and serial number.
        name: Name of the device.
        alias: Its station alias.
    """
    head = bytearray(0x80)
    struct.pack_into("<H", head, 0, 0x0005)
    struct.pack_into("<H", head, 8, alias)
    head[14] = _checksum(bytes(head[:14]))
    struct.pack_into("<IIII", head, 0x10, *identity)
    boxes = (MAILBOX_OUT, MAILBOX_SIZE, MAILBOX_IN, MAILBOX_SIZE)
    struct.pack_into("<4H", head, 0x28, *boxes)
    struct.pack_into("<5H", head, 0x30, *boxes, 0x0004)
    struct.pack_into("<HH", head, 0x7C, 0x000F, 1)
    text = bytes([1, len(name)]) + name.encode()
    general = bytearray(32)
    general[3], general[5], general[13] = 1, 0x01, 0x01
    managers = (
        (MAILBOX_OUT, MAILBOX_SIZE, 0x26, 0, 1, 1),
        (MAILBOX_IN, MAILBOX_SIZE, 0x22, 0, 1, 2),
        (DATA_OUT, 0, 0x64, 0, 1, 3),
        (DATA_IN, 0, 0x20, 0, 1, 4),
    )
    sections = (
        (10, text),
        (30, bytes(general)),
        (40, bytes([1, 2, 3, 0])),
        (41, b"".join(struct.pack("<HHBBBB", *manager) for manager in managers)),
    )
    image = bytes(head)
    for kind, data in sections:
        data += b"\xff" * (len(data) % 2)
        image += struct.pack("<HH", kind, len(data) // 2) + data
    return (image + b"\xff\xff\xff\xff").ljust(2048, b"\xff")


def _checksum(data: bytes) -> int:
    """CRC-8 with polynomial x⁸ + x² + x + 1, started with 0xFF."""
    value = 0xFF
    for byte in data:
        value ^= byte
        for _ in range(8):
            value = (value << 1 ^ (0x07 if value & 0x80 else 0)) & 0xFF
    return value
