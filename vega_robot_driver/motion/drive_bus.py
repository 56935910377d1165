# SPDX-License-Identifier: Apache-2.0
"""The drives of an EtherCAT bus: found by serial number, configured, exchanged with.

What the drives are told and what they told lies in lists by axis; one call of `exchange` is
one frame.
"""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

from vega_planner.errors import DriverError, LinkTimeout
from vega_robot_driver.motion.bus_config import BusAxis, BusConfig, Mapped
from vega_robot_driver.motion.cia402 import DISABLE_VOLTAGE, State, state_of

_FORMS = {8: "B", 16: "H", 32: "I"}
_SIGNED = {
    0x6060: "b", 0x6061: "b", 0x6064: "i", 0x606C: "i", 0x607A: "i", 0x6071: "h", 0x6077: "h",
}  # fmt: skip
#: Where the value of each object that is sent lies; what is not listed is sent as 0.
_SENT = {0x6040: "control", 0x6060: "mode", 0x6071: "torque", 0x607A: "target", 0x60FE: "outputs"}
#: Cycles that reaching a bus state may take.
PATIENCE = 1000
#: Tries of a configuration step: short built-in time-outs fail now and then under load.
TRIES = 3
#: Where the station alias lies in the EEPROM [words].
_ALIAS = 4
_Answer = TypeVar("_Answer")


class Identity(NamedTuple):
    """What a drive says that it is; 0 for what was not asked."""

    vendor: int
    product: int
    serial: int
    alias: int


class DriveBus:
    """A line of drives, in the order of the joints.

    Args:
        config: The bus, its axes in the order of the joints.
        interface: Network interface.
        dt: Cycle time [s].
        timeout_us: Time a frame may take to come back.

    Attributes:
        control: Control words.
        mode: Modes of operation.
        target: Target positions [increments].
        torque: Target torques [per mille].
        outputs: Digital outputs.
        status: Status words.
        states: What they say.
        position: Positions [increments].
        speed: Speeds [increments/s].
        errors: Error codes.
        clocked: Whether distributed clocks are in use.
        wrong: Cycles with a wrong working counter.
        wrong_in_a_row: Those of them that followed each other until now.
    """

    def __init__(
        self, config: BusConfig, interface: str, *, dt: float, timeout_us: int = 1500
    ) -> None:
        self._config, self._interface, self._dt, self._timeout = config, interface, dt, timeout_us
        self._master: Any = None
        self._slaves: list[Any] = []
        self._received, self._receive = _layout(config.txpdo)
        self._sent, self._send = _layout(config.rxpdo)
        count = len(config.axes)
        self.control = [DISABLE_VOLTAGE] * count
        self.mode = [0] * count
        self.target, self.torque, self.outputs = [0] * count, [0] * count, [0] * count
        self.status, self.position, self.speed = [0] * count, [0] * count, [0] * count
        self.states = [State.NOT_READY] * count
        self.errors = [0] * count
        self.clocked = False
        self.wrong = self.wrong_in_a_row = 0
        self._nothing = [0] * count
        self._columns = [
            self._received.index(index) if index in self._received else -1
            for index in (0x6041, 0x6064, 0x606C, 0x603F)
        ]

    @property
    def is_open(self) -> bool:
        """Whether the bus is up."""
        return self._master is not None

    def open(self) -> None:
        """Bring the bus up to operational; the axes stay without power.

        Raises:
            DriverError: If the interface, a drive or its identity is not as configured.
        """
        for left in reversed(range(TRIES)):
            try:
                self._bring_up()
                return
            except LinkTimeout:
                self.close()
                if not left:
                    raise

    def _bring_up(self) -> None:
        import pysoem

        self._master = pysoem.Master()
        try:
            self._master.open(self._interface)
        except ConnectionError as error:
            self._master = None
            raise DriverError(
                f"interface '{self._interface}' cannot be opened: it does not exist, or the "
                "process lacks CAP_NET_RAW and CAP_NET_ADMIN"
            ) from error
        found = self._master.config_init()
        if found < len(self._config.axes):
            raise LinkTimeout(
                f"{max(found, 0)} drives answer on '{self._interface}'; "
                f"{len(self._config.axes)} are configured"
            )
        self._slaves = self._identified()
        for slave, axis in zip(self._slaves, self._config.axes, strict=True):
            slave.config_func = self._configuration(slave, axis)
        self._master.config_map()
        self._start_clocks()
        self._reach(pysoem.SAFEOP_STATE)
        self.exchange()
        self.target = list(self.position)
        self._reach(pysoem.OP_STATE)

    def close(self) -> None:
        """Take the bus down; safe to call twice."""
        import pysoem

        master, self._master = self._master, None
        if master is not None:
            with contextlib.suppress(Exception):
                master.state = pysoem.INIT_STATE
                master.write_state()
            master.close()

    def abandon(self) -> None:
        """Leave the line without a word, as a killed process does."""
        master, self._master = self._master, None
        if master is not None:
            master.close()

    def _identified(self) -> list[Any]:
        """Find each axis's drive by serial number or alias, wherever it is on the line."""
        kinds = {axis.known_by[0] for axis in self._config.axes}
        slaves, identities = self._identities(kinds)
        found = []
        for axis in self._config.axes:
            kind, number = axis.known_by
            there = [getattr(identity, kind) for identity in identities]
            if there.count(number) != 1:
                several = "no drive has" if number not in there else "several drives have"
                raise DriverError(f"{several} {axis.joint}'s {kind} {number}; found: {there}")
            place = there.index(number)
            vendor, product, *_ = identities[place]
            if (vendor, product) != (axis.vendor, axis.product):
                raise DriverError(
                    f"the drive of {axis.joint} ({kind} {number}) is vendor 0x{vendor:X} "
                    f"product 0x{product:X}; configured: 0x{axis.vendor:X} 0x{axis.product:X}"
                )
            found.append(slaves[place])
        return found

    def _identities(self, kinds: set[str]) -> tuple[list[Any], list[Identity]]:
        """Ask all drives of the line who they are, and for what they are known by."""
        slaves = list(self._master.slaves)

        def asked(kind: str, slave: Any) -> int:
            if kind not in kinds:
                return 0
            if kind == "serial":
                return int.from_bytes(_retried(lambda: slave.sdo_read(0x1018, 4)), "little")
            return int.from_bytes(_retried(lambda: slave.eeprom_read(_ALIAS))[:2], "little")

        return slaves, [
            Identity(slave.man, slave.id, asked("serial", slave), asked("alias", slave))
            for slave in slaves
        ]

    def _configuration(self, slave: Any, axis: BusAxis) -> Callable[[int], None]:
        config = self._config

        def write(index: int, sub: int, form: str, value: int) -> None:
            _retried(lambda: slave.sdo_write(index, sub, struct.pack("<" + form, value)))

        def configure(_: int) -> None:
            for assignment, pdo, mapped in (
                (0x1C12, 0x1600, config.rxpdo),
                (0x1C13, 0x1A00, config.txpdo),
            ):
                write(assignment, 0, "B", 0)
                write(pdo, 0, "B", 0)
                for number, item in enumerate(mapped, 1):
                    write(pdo, number, "I", item.word)
                write(pdo, 0, "B", len(mapped))
                write(assignment, 1, "H", pdo)
                write(assignment, 0, "B", 1)
            write(0x60C2, 1, "B", max(1, round(self._dt * 1000)))
            write(0x60C2, 2, "b", -3)
            write(0x6065, 0, "I", axis.following_error)
            if config.sync_error_limit:
                write(0x10F1, 2, "I", config.sync_error_limit)
            if axis.homing is not None:
                write(0x6098, 0, "b", axis.homing.method)
                write(0x6099, 1, "I", axis.homing.speed)
                write(0x6099, 2, "I", axis.homing.slow)
                write(0x609A, 0, "I", axis.homing.acceleration)
                write(0x607C, 0, "i", axis.homing.offset)
            _retried(lambda: slave.set_watchdog("processdata", config.watchdog_ms))

        return configure

    def _start_clocks(self) -> None:
        """Let the drives take their cycle from distributed clocks, where they have them."""
        wish = self._config.distributed_clocks
        if wish == "off":
            return
        self.clocked = bool(self._master.config_dc())
        if self.clocked:
            for slave in self._slaves:
                slave.dc_sync(True, round(self._dt * 1e9))
        elif wish == "on":
            raise DriverError(
                "the drives have no distributed clocks; the machine file asks for them "
                "(distributed_clocks: on)"
            )

    def _reach(self, state: int) -> None:
        """Ask for a bus state and exchange frames until all drives are in it."""
        master = self._master
        master.state = state
        master.write_state()
        for _ in range(PATIENCE):
            self.exchange()
            if master.state_check(state, 2000) == state:
                return
        master.read_state()
        told = [f"0x{slave.state:02X}/0x{slave.al_status:04X}" for slave in master.slaves]
        raise LinkTimeout(f"the bus does not reach state {state}; drives (state/code): {told}")

    def recover(self) -> None:
        """Bring drives back that left operational while they had no power."""
        import pysoem

        master = self._master
        if master.read_state() == pysoem.OP_STATE and self.exchange():
            return
        for slave in master.slaves:
            if slave.state != pysoem.OP_STATE:
                slave.state = pysoem.SAFEOP_STATE + pysoem.STATE_ACK
                slave.write_state()
        self._reach(pysoem.OP_STATE)

    def exchange(self) -> bool:
        """Exchange one frame; true where every drive took part."""
        columns = [getattr(self, _SENT.get(index, "_nothing")) for index in self._sent]
        received = self._transfer([self._send.pack(*row) for row in zip(*columns, strict=True)])
        if received is None:
            self.wrong += 1
            self.wrong_in_a_row += 1
            return False
        self.wrong_in_a_row = 0
        found = list(zip(*map(self._receive.unpack, received), strict=True))
        self.status, self.position, self.speed, self.errors = (
            list(found[column]) if column >= 0 else list(self._nothing) for column in self._columns
        )
        self.states = [state_of(status) for status in self.status]
        return True

    def _transfer(self, sent: list[bytes]) -> list[bytes] | None:
        """Send each drive its data and get theirs; None where not all took part."""
        for slave, data in zip(self._slaves, sent, strict=True):
            slave.output = data
        self._master.send_processdata()
        counter = self._master.receive_processdata(self._timeout)
        if counter != self._master.expected_wkc:
            return None
        return [slave.input for slave in self._slaves]

    @property
    def clock_offset(self) -> float:
        """How far the frame was from the middle of the drives' cycle [s]; 0 without clocks."""
        if not self.clocked:
            return 0.0
        cycle = round(self._dt * 1e9)
        return (self._master.dc_time % cycle - cycle // 2) * 1e-9


def _layout(mapped: tuple[Mapped, ...]) -> tuple[list[int], struct.Struct]:
    """Objects of a mapping in order, and how they lie in the bytes."""
    forms = [_SIGNED.get(item.index, _FORMS[item.bits]) for item in mapped]
    return [item.index for item in mapped], struct.Struct("<" + "".join(forms))


def _retried(work: Callable[[], _Answer]) -> _Answer:
    """Try a mailbox transfer or register access again where it times out."""
    import pysoem

    for left in reversed(range(TRIES)):
        try:
            return work()
        except pysoem.SdoError as error:
            raise DriverError(f"a drive refuses a setting: {error}") from error
        except (pysoem.WkcError, pysoem.MailboxError, pysoem.PacketError) as error:
            if not left:
                raise LinkTimeout(f"a drive does not answer: {error}") from error
    raise AssertionError("unreachable")
