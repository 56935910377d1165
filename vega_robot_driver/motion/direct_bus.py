# SPDX-License-Identifier: Apache-2.0
"""Emulated drives in this process: the same frames, without a wire between.

A small master of its own beside pysoem: it writes the registers and mapping that the drives'
controllers ask for (ETG.1000.4) and exchanges one LRW datagram a cycle. It needs no network
interface, no privilege and no second process, and one cycle takes as long as its arithmetic.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path

from vega_planner.errors import DriverError
from vega_robot_driver.emulators.faults import parsed
from vega_robot_driver.emulators.line import Line, build_segment
from vega_robot_driver.emulators.slave_controller import (
    DATA_IN,
    DATA_OUT,
    INIT,
    MAILBOX_IN,
    MAILBOX_OUT,
    MAILBOX_SIZE,
    OP,
    PREOP,
    SAFEOP,
    SlaveController,
)
from vega_robot_driver.motion.bus_config import BusAxis, BusConfig, Mapped
from vega_robot_driver.motion.drive_bus import DriveBus, Identity
from vega_robot_driver.motion.ethercat import EthercatMotion

_HEADER = bytes(12) + b"\x88\xa4"
_LRW = 12
_ACKNOWLEDGE = 0x10
#: Ticks of the watchdog's divider in a millisecond: (0x9C2 + 2) times 40 ns are 0.1 ms.
_WATCHDOG_TICKS = 10


class DirectBus(DriveBus):
    """A bus whose drives are objects.

    Args:
        config: The bus, its axes in the order of the joints.
        line: The drives.
        dt: Cycle time [s].
    """

    def __init__(self, config: BusConfig, line: Line, *, dt: float) -> None:
        super().__init__(config, "", dt=dt)
        self._line = line
        self._sizes = (_size(config.rxpdo), _size(config.txpdo))
        self._open = False

    @property
    def is_open(self) -> bool:
        """Whether the bus is up."""
        return self._open

    def open(self) -> None:
        """Bring all drives to operational."""
        self._slaves = self._identified()
        for number, (slave, axis) in enumerate(zip(self._slaves, self._config.axes, strict=True)):
            self._configure(slave, axis, number)
        self._open = True
        self.exchange()
        self.target = list(self.position)
        self._request(OP)
        self.exchange()
        if not self.exchange():
            raise DriverError("the drives do not reach operational")

    def close(self) -> None:
        """Take the bus down."""
        if self._open:
            self._request(INIT)
        self._open = False

    def abandon(self) -> None:
        """Leave the line without a word."""
        self._open = False

    def recover(self) -> None:
        """Bring drives back that left operational."""
        for slave in self._slaves:
            if slave.state != OP:
                slave.write(0x120, bytes([SAFEOP | _ACKNOWLEDGE, 0]))
        self._request(OP)
        self.exchange()
        self.exchange()

    def _identities(self, kinds: set[str]) -> tuple[list[SlaveController], list[Identity]]:
        slaves = list(self._line.segment.slaves)
        told = [(*slave.drive.identity, slave.alias) for slave in slaves]
        return slaves, [
            Identity(vendor, product, serial, alias) for vendor, product, _, serial, alias in told
        ]

    def _configure(self, slave: SlaveController, axis: BusAxis, number: int) -> None:
        """Lead a drive from INIT to SAFEOP with the configured mapping."""
        config, objects = self._config, slave.drive.objects
        slave.write(0x120, bytes([INIT | _ACKNOWLEDGE, 0]))
        out_size, in_size = self._sizes
        managers = (
            (MAILBOX_OUT, MAILBOX_SIZE, 0x26),
            (MAILBOX_IN, MAILBOX_SIZE, 0x22),
            (DATA_OUT, out_size, 0x64),
            (DATA_IN, in_size, 0x20),
        )
        packed = [struct.pack("<HHBBBB", *manager, 0, 1, 0) for manager in managers]
        slave.write(0x800, b"".join(packed))
        slave.write(0x120, bytes([PREOP, 0]))
        for assignment, pdo, mapped in (
            (0x1C12, 0x1600, config.rxpdo),
            (0x1C13, 0x1A00, config.txpdo),
        ):
            for place, item in enumerate(mapped, 1):
                objects.write(pdo, place, struct.pack("<I", item.word))
            objects.write(pdo, 0, bytes([len(mapped)]))
            objects.write(assignment, 1, struct.pack("<H", pdo))
        objects.write(0x60C2, 1, bytes([max(1, round(self._dt * 1000))]))
        objects.write(0x6065, 0, struct.pack("<I", axis.following_error))
        if axis.homing is not None:
            objects.write(0x6098, 0, struct.pack("<b", axis.homing.method))
            objects.write(0x6099, 1, struct.pack("<I", axis.homing.speed))
            objects.write(0x6099, 2, struct.pack("<I", axis.homing.slow))
            objects.write(0x609A, 0, struct.pack("<I", axis.homing.acceleration))
            objects.write(0x607C, 0, struct.pack("<i", axis.homing.offset))
        objects.write(0x10F1, 2, struct.pack("<I", config.sync_error_limit))
        slave.write(0x420, struct.pack("<H", config.watchdog_ms * _WATCHDOG_TICKS))
        window = "<IHBBHBBB4x"
        at = number * out_size
        slave.write(0x600, struct.pack(window, at, out_size, 0, 7, DATA_OUT, 0, 2, 1))
        at = len(config.axes) * out_size + number * in_size
        slave.write(0x610, struct.pack(window, at, in_size, 0, 7, DATA_IN, 0, 1, 1))
        if config.sync_error_limit:  # its cycle is the clocks', so that missed ones count
            slave.write(0x9A0, struct.pack("<I", round(self._dt * 1e9)))
        slave.write(0x120, bytes([SAFEOP, 0]))
        if config.sync_error_limit:
            slave.write(0x981, bytes([3]))

    def _request(self, state: int) -> None:
        for slave in self._slaves:
            slave.write(0x120, bytes([state, 0]))

    def _transfer(self, sent: list[bytes]) -> list[bytes] | None:
        _, in_size = self._sizes
        data = b"".join(sent) + bytes(in_size * len(sent))
        datagram = struct.pack("<BBIHH", _LRW, 0, 0, len(data), 0) + data + bytes(2)
        frame = _HEADER + struct.pack("<H", 0x1000 | len(datagram)) + datagram
        answer = self._line.frame(frame)
        self._line.settle()
        if answer is None or struct.unpack_from("<H", answer, len(answer) - 2)[0] != 3 * len(sent):
            return None
        start = 26 + sum(map(len, sent))
        return [answer[start + k * in_size : start + (k + 1) * in_size] for k in range(len(sent))]


class DirectDrives:
    """The drives, and what can be asked of them.

    Args:
        config: The bus as its file has it.
        cycle: Time that passes with each frame [s].
    """

    def __init__(self, config: BusConfig, cycle: float) -> None:
        self.line = Line(build_segment(config), cycle)

    def inject(self, fault: str) -> None:
        """Let something fail: a fault and its number, see `FAULTS`."""
        kind, number = parsed(fault)
        self.line.obey({"fault": kind, "number": number})

    def tell(self, **message: object) -> None:
        """Tell the drives something."""
        self.line.obey(json.loads(json.dumps(message)))


class DirectMotion(EthercatMotion):
    """The EtherCAT axes on drives in this process.

    Args:
        config: The bus, its axes in the order of the joints.
        drives: The drives; they live on when this is abandoned.
        dt: Cycle time [s].
        memory: As of `EthercatMotion`.
    """

    def __init__(
        self, config: BusConfig, drives: DirectDrives, *, dt: float, memory: Path | None = None
    ) -> None:
        bus = DirectBus(config, drives.line, dt=dt)
        super().__init__(config, "", dt=dt, batched=True, memory=memory, bus=bus)
        self.drives = drives

    def inject(self, fault: str) -> None:
        """Let something fail."""
        self.drives.inject(fault)


def _size(mapped: tuple[Mapped, ...]) -> int:
    return sum(item.bits for item in mapped) // 8
