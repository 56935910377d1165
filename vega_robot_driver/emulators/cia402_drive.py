# SPDX-License-Identifier: Apache-2.0
"""An emulated servo drive after CiA 402, with its axis behind it.

The object dictionary is the generic one of the standard: no particular maker's. Dynamics and
limits are invented.
"""

from __future__ import annotations

from dataclasses import dataclass

from vega_robot_driver.emulators.object_dictionary import (
    WRONG_STATE,
    Abort,
    Entry,
    ObjectDictionary,
)
from vega_robot_driver.motion.cia402 import STATUS_BITS, State

PRE_OPERATIONAL = 2
CYCLIC_SYNCHRONOUS_POSITION = 8
FOLLOWING_ERROR, LIMIT_SWITCH, SAFE_TORQUE_OFF = 0x8611, 0x8681, 0xFF01


@dataclass
class Axis:
    """A linear or rotary axis, in increments.

    Attributes:
        travel: Hard stops.
        speed_limit: Largest speed [1/s].
        acceleration_limit: Largest acceleration [1/s²].
        lag_s: Time constant of the position loop.
        position: Where it is.
        speed: How fast it moves.
        jammed: Whether something blocks it.
    """

    travel: tuple[float, float]
    speed_limit: float
    acceleration_limit: float
    lag_s: float = 0.0015
    position: float = 0.0
    speed: float = 0.0
    jammed: bool = False

    def move(self, wanted_speed: float, dt: float) -> None:
        """Change the speed as far as the motor can, and move."""
        wanted = min(max(wanted_speed, -self.speed_limit), self.speed_limit)
        most = self.acceleration_limit * dt
        self.speed += min(max(wanted - self.speed, -most), most)
        if self.jammed:
            self.speed = 0.0
        self.position += self.speed * dt
        low, high = self.travel
        if not low <= self.position <= high:
            self.position, self.speed = min(max(self.position, low), high), 0.0


class Cia402Drive:
    """A drive in cyclic synchronous position mode.

    Args:
        axis: What it moves.
        identity: Vendor, product, revision and serial number.
    """

    def __init__(self, axis: Axis, identity: tuple[int, int, int, int]) -> None:
        self.axis = axis
        self.identity = identity
        self.state = State.SWITCH_ON_DISABLED
        self.bus_state = 1
        self.emergencies: list[tuple[int, int]] = []
        self.torque_off = False
        self._demand = axis.position
        self._step = 0.0
        self._left_s = 0.0
        self._outside_s = 0.0
        self._previous_control = 0
        self._fresh = False
        self._received: list[Entry | int] = []
        self._sent: list[Entry | int] = []
        self.objects = ObjectDictionary(before_write=self._check_write)
        self._fill(self.objects)

    # -- bus ------------------------------------------------------------------------------

    def compile_mapping(self) -> tuple[int, int]:
        """Fix the mapping of the process data; returns bytes received and sent a cycle."""
        self._received = self.objects.mapping(0x1C12)
        self._sent = self.objects.mapping(0x1C13)
        return _size(self._received), _size(self._sent)

    def take_outputs(self, data: bytes) -> None:
        """Take the process data that the master sent."""
        at = 0
        for item in self._received:
            if isinstance(item, int):
                at += item
                continue
            signed = item.form.islower()
            item.value = int.from_bytes(data[at : at + item.size], "little", signed=signed)
            at += item.size
        self._fresh = True

    def give_inputs(self) -> bytes:
        """Give the process data for the master."""
        return b"".join(
            bytes(item) if isinstance(item, int) else item.packed() for item in self._sent
        )

    def lose_master(self) -> None:
        """The master is silent, or took the bus down: outputs off, stop quickly."""
        self.objects.entry(0x60FE, 1).value = 0
        if self.state == State.OPERATION_ENABLED:
            self.state = State.QUICK_STOP_ACTIVE

    # -- behaviour ------------------------------------------------------------------------

    def fault(self, code: int) -> None:
        """Trip."""
        if self.state not in (State.FAULT_REACTION_ACTIVE, State.FAULT):
            self.objects[0x603F] = code
            self.objects[0x1001] = 0x21
            self.emergencies.append((code, 0x21))
            self.objects.entry(0x60FE, 1).value = 0
            moving = self.state in (State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE)
            self.state = State.FAULT_REACTION_ACTIVE if moving else State.FAULT

    def step(self, dt: float) -> None:
        """Let time pass."""
        self._obey()
        axis, objects = self.axis, self.objects
        if self.state == State.OPERATION_ENABLED:
            self._interpolate(dt)
            axis.move((self._demand - axis.position) / axis.lag_s, dt)
        else:
            axis.move(0.0, dt)
            self._demand = axis.position
        error = self._demand - axis.position
        self._watch_error(abs(error), dt)
        bits = STATUS_BITS[self.state] | 0x0210
        if self.state == State.OPERATION_ENABLED:
            bits |= 0x1000
        objects[0x6041] = bits
        objects[0x6061] = objects[0x6060]
        objects[0x6064] = round(axis.position)
        objects[0x606C] = round(axis.speed)
        objects[0x60F4] = round(error)
        low, high = axis.travel
        objects[0x60FD] = (axis.position <= low) | (axis.position >= high) << 1
        if objects[0x60FD] and self.state == State.OPERATION_ENABLED:
            self.fault(LIMIT_SWITCH)

    def _obey(self) -> None:
        """Follow the control word (CiA 402-2, transitions 2 to 16)."""
        control, previous = self.objects[0x6040], self._previous_control
        self._previous_control = control
        state, still = self.state, abs(self.axis.speed) < 1.0
        if state == State.FAULT_REACTION_ACTIVE:
            if still:
                self.state = State.FAULT
        elif state == State.FAULT:
            if control & 0x80 and not previous & 0x80 and not self.torque_off:
                self.state = State.SWITCH_ON_DISABLED
                self.objects[0x603F] = self.objects[0x1001] = 0
        elif self.torque_off:
            if state == State.OPERATION_ENABLED:
                self.fault(SAFE_TORQUE_OFF)
        elif not control & 0x02:
            self.state = State.SWITCH_ON_DISABLED
        elif not control & 0x04:
            if state == State.OPERATION_ENABLED:
                self.state = State.QUICK_STOP_ACTIVE
            elif state != State.QUICK_STOP_ACTIVE or still:
                self.state = State.SWITCH_ON_DISABLED
        elif state == State.QUICK_STOP_ACTIVE:
            if still:
                self.state = State.SWITCH_ON_DISABLED
        else:
            self._climb(control & 0x0F)

    def _climb(self, command: int) -> None:
        state = self.state
        if state == State.SWITCH_ON_DISABLED and command & 7 == 6:
            self.state = State.READY_TO_SWITCH_ON
        elif state == State.READY_TO_SWITCH_ON and command & 7 == 7:
            self.state = State.SWITCHED_ON
        elif state == State.SWITCHED_ON and command == 0x0F:
            self.state, self._demand, self._left_s = (
                State.OPERATION_ENABLED,
                self.axis.position,
                0.0,
            )
            window = self.objects[0x6065]
            if abs(self.objects[0x607A] - self.axis.position) > window:
                self.fault(FOLLOWING_ERROR)  # a real drive would jump, or trip
        elif command & 7 == 6 and state in (State.SWITCHED_ON, State.OPERATION_ENABLED):
            self.state = State.READY_TO_SWITCH_ON
        elif command == 7 and state == State.OPERATION_ENABLED:
            self.state = State.SWITCHED_ON

    def _interpolate(self, dt: float) -> None:
        """Go to the last target within the interpolation time, no faster than allowed."""
        if self._fresh:
            self._fresh = False
            low, high = self.objects.entry(0x607D, 1).value, self.objects.entry(0x607D, 2).value
            target = min(max(self.objects[0x607A], low), high)
            exponent = self.objects.entry(0x60C2, 2).value
            time_s = self.objects.entry(0x60C2, 1).value * 10.0**exponent
            limit = self.axis.speed_limit
            self._step = min(max((target - self._demand) / time_s, -limit), limit)
            self._left_s = time_s
        part = min(dt, self._left_s)
        self._demand += self._step * part
        self._left_s -= part

    def _watch_error(self, error: float, dt: float) -> None:
        if self.state != State.OPERATION_ENABLED or error <= self.objects[0x6065]:
            self._outside_s = 0.0
            return
        self._outside_s += dt
        if self._outside_s * 1000 >= self.objects[0x6066]:
            self.fault(FOLLOWING_ERROR)

    def _check_write(self, index: int, sub: int, value: int) -> None:
        if index in (0x1600, 0x1A00, 0x1C12, 0x1C13) and self.bus_state != PRE_OPERATIONAL:
            raise Abort(WRONG_STATE)

    def _fill(self, objects: ObjectDictionary) -> None:
        low, high = (round(value) for value in self.axis.travel)
        objects.add(0x1000, "I", 0x00020192, writable=False)
        objects.add(0x1001, "B", 0, writable=False)
        objects.add_list(0x1018, "I", list(self.identity))
        objects.add_list(0x1600, "I", [0x60400010, 0x607A0020], room=8)
        objects.add_list(0x1A00, "I", [0x60410010, 0x60640020], room=8)
        objects.add_list(0x1C00, "B", [1, 2, 3, 4])
        objects.add_list(0x1C12, "H", [0x1600])
        objects.add_list(0x1C13, "H", [0x1A00])
        for index, form, value, writable in (
            (0x603F, "H", 0, False),
            (0x6040, "H", 0, True),
            (0x6041, "H", STATUS_BITS[self.state], False),
            (0x6060, "b", CYCLIC_SYNCHRONOUS_POSITION, True),
            (0x6061, "b", CYCLIC_SYNCHRONOUS_POSITION, False),
            (0x6064, "i", round(self.axis.position), False),
            (0x6065, "I", 1000, True),
            (0x6066, "H", 20, True),
            (0x606C, "i", 0, False),
            (0x6077, "h", 0, False),
            (0x607A, "i", round(self.axis.position), True),
            (0x60F4, "i", 0, False),
            (0x60FD, "I", 0, False),
        ):
            objects.add(index, form, value, writable=writable)
        objects.add_list(0x607D, "i", [low, high])
        objects.add(0x60C2, "B", 2, writable=False)
        objects.add(0x60C2, "B", 2, sub=1)
        objects.add(0x60C2, "b", -3, sub=2)
        objects.add_list(0x60FE, "I", [0, 0])


def _size(items: list[Entry | int]) -> int:
    return sum(item if isinstance(item, int) else item.size for item in items)
