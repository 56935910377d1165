# SPDX-License-Identifier: Apache-2.0
"""EtherCAT drives after CiA 402 in cyclic synchronous position mode.

Axes are known by the serial numbers of their drives. Every cycle checks the working counter
and every drive's state; what is wrong stops all axes.
"""

from __future__ import annotations

import contextlib
import struct
import time
from dataclasses import replace
from typing import Any

import numpy as np

from vega_planner.datatypes import Bools, Floats
from vega_planner.errors import DriverError, Faulted, LinkTimeout
from vega_robot_driver.motion.base import AxisState, Feedback, LinkQuality, MotionController
from vega_robot_driver.motion.bus_config import BusAxis, BusConfig, Mapped
from vega_robot_driver.motion.cia402 import (
    DISABLE_VOLTAGE,
    FAULT_RESET,
    QUICK_STOP,
    TOWARDS_ENABLED,
    State,
    state_of,
)

_FORMS = {8: "B", 16: "H", 32: "I"}
_SIGNED = {0x6060: "b", 0x6061: "b", 0x6064: "i", 0x606C: "i", 0x607A: "i", 0x6077: "h"}
_POSITION_MODE = 8
#: Cycles that reaching a bus state, or enabling, may take.
_PATIENCE = 1000
#: Tries of a configuration step: short built-in time-outs fail now and then under load.
_TRIES = 3


class EthercatMotion(MotionController):
    """The axes of a bus.

    Args:
        config: The bus, its axes in the order of the joints.
        interface: Network interface.
        dt: Cycle time [s].
        timeout_us: Time a frame may take to come back.
        batched: Whether cycles may be exchanged without pacing (frame-clocked emulation).
    """

    def __init__(
        self,
        config: BusConfig,
        interface: str,
        *,
        dt: float = 0.002,
        timeout_us: int = 1500,
        batched: bool = False,
    ) -> None:
        self.joint_names = tuple(axis.joint for axis in config.axes)
        self.dt, self.batched = dt, batched
        self._config, self._interface, self._timeout = config, interface, timeout_us
        self._master: Any = None
        self._slaves: list[Any] = []
        self._received, self._receive = _layout(config.txpdo)
        self._sent, self._send = _layout(config.rxpdo)
        count = len(config.axes)
        self._control = [DISABLE_VOLTAGE] * count
        self._target = [0] * count
        self._position = [0] * count
        self._speed = [0] * count
        self._states = [State.NOT_READY] * count
        self._errors = [0] * count
        self._valve = (
            self.joint_names.index(config.dispenser_joint) if config.dispenser_joint else -1
        )
        self._gate = False
        self._enabled = False
        self._wrong = self._wrong_in_a_row = 0

    # -- link -----------------------------------------------------------------------------

    def open(self) -> None:
        """Bring the bus up to operational; the axes stay without power.

        Raises:
            DriverError: If the interface, a drive or its identity is not as configured.
        """
        for left in reversed(range(_TRIES)):
            try:
                self._bring_up()
                return
            except LinkTimeout:
                EthercatMotion.close(self)
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
            raise DriverError(
                f"{max(found, 0)} drives answer on '{self._interface}'; "
                f"{len(self._config.axes)} are configured"
            )
        self._slaves = [self._identified(axis) for axis in self._config.axes]
        for slave, axis in zip(self._slaves, self._config.axes, strict=True):
            slave.config_func = self._configure(slave, axis)
        self._master.config_map()
        self._reach(pysoem.SAFEOP_STATE)
        self._exchange_once()
        self._target = list(self._position)
        self._reach(pysoem.OP_STATE)

    def close(self) -> None:
        """Take the bus down."""
        import pysoem

        master, self._master = self._master, None
        if master is not None:
            with contextlib.suppress(Exception):
                master.state = pysoem.INIT_STATE
                master.write_state()
            master.close()

    def _identified(self, axis: BusAxis) -> Any:
        """Find an axis's drive by its serial number."""
        seen = []
        for slave in self._master.slaves:
            serial = struct.unpack("<I", _retried(lambda s=slave: s.sdo_read(0x1018, 4)))[0]
            seen.append(serial)
            if serial != axis.serial:
                continue
            if (slave.man, slave.id) != (axis.vendor, axis.product):
                raise DriverError(
                    f"the drive of {axis.joint} (serial {serial}) is vendor 0x{slave.man:X} "
                    f"product 0x{slave.id:X}; configured: 0x{axis.vendor:X} 0x{axis.product:X}"
                )
            return slave
        raise DriverError(
            f"no drive has {axis.joint}'s serial number {axis.serial}; found: {seen}"
        )

    def _configure(self, slave: Any, axis: BusAxis) -> Any:
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
            write(0x60C2, 1, "B", max(1, round(self.dt * 1000)))
            write(0x60C2, 2, "b", -3)
            write(0x6065, 0, "I", axis.following_error)
            _retried(lambda: slave.set_watchdog("processdata", config.watchdog_ms))

        return configure

    def _reach(self, state: int) -> None:
        """Ask for a bus state and exchange frames until all drives are in it."""
        master = self._master
        master.state = state
        master.write_state()
        for _ in range(_PATIENCE):
            self._exchange_once()
            if master.state_check(state, 2000) == state:
                return
        master.read_state()
        told = [f"0x{slave.state:02X}/0x{slave.al_status:04X}" for slave in master.slaves]
        raise LinkTimeout(f"the bus does not reach state {state}; drives (state/code): {told}")

    def _recover(self) -> None:
        """Bring drives back that left operational while they had no power."""
        import pysoem

        master = self._master
        if master.read_state() == pysoem.OP_STATE and self._exchange_once():
            return
        for slave in master.slaves:
            if slave.state != pysoem.OP_STATE:
                slave.state = pysoem.SAFEOP_STATE + pysoem.STATE_ACK
                slave.write_state()
        self._reach(pysoem.OP_STATE)

    # -- cycles ---------------------------------------------------------------------------

    def enable(self) -> Feedback:
        """Power the axes where they are.

        Raises:
            Faulted: Naming the axes that do not come up.
        """
        for _ in range(_TRIES):
            self._recover()
            if self._climb():
                self._enabled = True
                return self._feedback()
            if State.FAULT in self._states:
                break
        raise Faulted(f"not enabled: {self._bad_axes()}")

    def _climb(self) -> bool:
        """Lead all drives to operation enabled."""
        wake = time.monotonic()
        for _ in range(_PATIENCE // 4):
            wake += self.dt
            if not self.batched:
                time.sleep(max(0.0, wake - time.monotonic()))
            self._target = list(self._position)  # nothing moves while they come up
            self._control = [TOWARDS_ENABLED[state] for state in self._states]
            self._exchange_once()
            if all(state is State.OPERATION_ENABLED for state in self._states):
                return True
            if State.FAULT in self._states:
                return False
        return False

    def exchange(self, targets: Floats, speeds: Floats, gate: Bools) -> Feedback:
        """Send targets cycle by cycle; stops at the first wrong one."""
        axes = self._config.axes
        for number, (row, on) in enumerate(zip(targets, gate, strict=True)):
            if self._enabled:
                self._target = [
                    axis.increments(value) for axis, value in zip(axes, row, strict=True)
                ]
            else:
                self._target = list(self._position)
            self._gate = bool(on)
            feedback = self._checked_cycle()
            if feedback.fault:
                self._gate = False
                return replace(feedback, cycles=number)
        return feedback

    def stop_quickly(self) -> Feedback:
        """Quick stop of all drives, valve closed."""
        self._gate = self._enabled = False
        self._control = [QUICK_STOP] * len(self._control)
        self._target = list(self._position)
        self._exchange_once()
        return self._feedback()

    def disable(self) -> None:
        """Take the power from the axes."""
        self._gate = self._enabled = False
        self._control = [DISABLE_VOLTAGE] * len(self._control)
        if self._master is not None:
            for _ in range(3):
                self._exchange_once()

    def reset_fault(self) -> None:
        """Acknowledge the drives' faults, once."""
        for control in (DISABLE_VOLTAGE, FAULT_RESET, DISABLE_VOLTAGE):
            self._control = [control] * len(self._control)
            for _ in range(3):
                self._exchange_once()
        self._wrong_in_a_row = 0

    def _checked_cycle(self) -> Feedback:
        good = self._exchange_once()
        if not good and self._wrong_in_a_row >= self._config.wrong_counters:
            return self._feedback(f"{self._wrong_in_a_row} wrong working counters in a row")
        enabled = all(state is State.OPERATION_ENABLED for state in self._states)
        if good and self._enabled and not enabled:
            return self._feedback(f"left operation enabled: {self._bad_axes()}")
        return self._feedback()

    def _exchange_once(self) -> bool:
        """Exchange one frame; true where every drive took part."""
        for number, slave in enumerate(self._slaves):
            values = {
                0x6040: self._control[number],
                0x6060: _POSITION_MODE,
                0x607A: self._target[number],
                0x60FE: self._outputs(number),
            }
            slave.output = self._send.pack(*[values.get(index, 0) for index in self._sent])
        self._master.send_processdata()
        counter = self._master.receive_processdata(self._timeout)
        good = counter == self._master.expected_wkc
        if not good:
            self._wrong += 1
            self._wrong_in_a_row += 1
            return False
        self._wrong_in_a_row = 0
        for number, slave in enumerate(self._slaves):
            values = dict(zip(self._received, self._receive.unpack(slave.input), strict=True))
            self._states[number] = state_of(values[0x6041])
            self._position[number] = values[0x6064]
            self._speed[number] = values.get(0x606C, 0)
            self._errors[number] = values.get(0x603F, 0)
        return True

    def _outputs(self, number: int) -> int:
        on = self._gate and number == self._valve
        return 1 << self._config.dispenser_bit if on else 0

    def _feedback(self, fault: str = "") -> Feedback:
        axes = self._config.axes
        places = [axis.position(value) for axis, value in zip(axes, self._position, strict=True)]
        speeds = [value / axis.scale for axis, value in zip(axes, self._speed, strict=True)]
        return Feedback(np.array(places), np.array(speeds), fault)

    # -- what is shown --------------------------------------------------------------------

    def axes(self) -> list[AxisState]:
        """Tell the state of each drive."""
        return [
            AxisState(name, state.value, code)
            for name, state, code in zip(self.joint_names, self._states, self._errors, strict=True)
        ]

    @property
    def quality(self) -> LinkQuality:
        """Wrong working counters so far."""
        return LinkQuality(wrong_counters=self._wrong)

    @property
    def homing_epoch(self) -> int:
        """Axes with absolute encoders keep their reference."""
        return 1

    def _bad_axes(self) -> str:
        return ", ".join(
            f"{axis.name} {axis.state}" + (f" (error 0x{axis.code:04X})" if axis.code else "")
            for axis in self.axes()
            if axis.state != State.OPERATION_ENABLED.value
        )


def _layout(mapped: tuple[Mapped, ...]) -> tuple[list[int], struct.Struct]:
    """Objects of a mapping in order, and how they lie in the bytes."""
    forms = [_SIGNED.get(item.index, _FORMS[item.bits]) for item in mapped]
    return [item.index for item in mapped], struct.Struct("<" + "".join(forms))


def _retried(work: Any) -> Any:
    """Try a mailbox transfer or register access again where it times out."""
    import pysoem

    for left in reversed(range(_TRIES)):
        try:
            return work()
        except (pysoem.WkcError, pysoem.MailboxError, pysoem.PacketError) as error:
            if not left:
                raise LinkTimeout(f"a drive does not answer: {error}") from error
    raise AssertionError("unreachable")
