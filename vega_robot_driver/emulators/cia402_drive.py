# SPDX-License-Identifier: Apache-2.0
"""An emulated servo drive after CiA 402, with its axis behind it.

Cyclic synchronous position, cyclic synchronous torque, and homing by three methods. The object
dictionary is the generic one of the standard: no particular maker's.
"""

from __future__ import annotations

import struct

from vega_robot_driver.emulators.axis import Axis
from vega_robot_driver.emulators.object_dictionary import (
    WRONG_STATE,
    Abort,
    Entry,
    ObjectDictionary,
)
from vega_robot_driver.motion.cia402 import STATUS_BITS, State

PRE_OPERATIONAL = 2
#: Longest step in which an axis is moved [s].
STEP = 0.001
_ENABLED = State.OPERATION_ENABLED
HOMING, CYCLIC_SYNCHRONOUS_POSITION, CYCLIC_SYNCHRONOUS_TORQUE = 6, 8, 10
FOLLOWING_ERROR, LIMIT_SWITCH, SAFE_TORQUE_OFF, HOMING_FAILED = 0x8611, 0x8681, 0xFF01, 0x8090
#: Methods of homing: with a move to the switch at the low end (17), at the high end (18), and
#: on the spot (37).
HOMING_METHODS = {17: -1, 18: 1, 37: 0}
#: How far it moves off the switch again [increments].
OFF_SWITCH = 20.0


class Cia402Drive:
    """A drive and its state machine.

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
        self.homed = axis.absolute
        self.largest_change = 0.0
        self._recent: list[int] = []
        self._homing = self._started = False
        self._mode = CYCLIC_SYNCHRONOUS_POSITION
        self._demand = axis.position
        self._pace = 0.0
        self._left_s = 0.0
        self._outside_s = 0.0
        self._previous_control = 0
        self._fresh = False
        self._received: list[Entry] = []
        self._sent: list[Entry] = []
        self._reader = self._writer = struct.Struct("")
        self.objects = ObjectDictionary(before_write=self._check_write)
        self._fill(self.objects)
        # What every step touches, found once.
        self._control, self._wanted_mode, self._window, self._patience = (
            self.objects.entry(index) for index in (0x6040, 0x6060, 0x6065, 0x6066)
        )
        self._interpolation = tuple(
            self.objects.entry(*at)
            for at in ((0x607D, 1), (0x607D, 2), (0x60C2, 1), (0x60C2, 2), (0x607A, 0))
        )
        self._shown = tuple(
            self.objects.entry(index) for index in (0x6041, 0x6061, 0x6064, 0x606C, 0x60F4, 0x60FD)
        )

    # -- bus ------------------------------------------------------------------------------

    def compile_mapping(self) -> tuple[int, int]:
        """Fix the mapping of the process data; returns bytes received and sent a cycle."""
        self._received, self._reader = _layout(self.objects.mapping(0x1C12))
        self._sent, self._writer = _layout(self.objects.mapping(0x1C13))
        return self._reader.size, self._writer.size

    def take_outputs(self, data: bytes) -> None:
        """Take the process data that the master sent."""
        for entry, value in zip(self._received, self._reader.unpack(data), strict=True):
            entry.value = value
        self._fresh = True

    def give_inputs(self) -> bytes:
        """Give the process data for the master."""
        return self._writer.pack(*[entry.value for entry in self._sent])

    def lose_master(self) -> None:
        """The master is silent, or took the bus down: outputs off, stop quickly."""
        self.objects.entry(0x60FE, 1).value = 0
        self._recent.clear()
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

    def pass_time(self, dt: float) -> None:
        """Let time pass, in steps of at most a millisecond."""
        steps = max(1, round(dt / STEP))
        for _ in range(steps):
            self._step(dt / steps)
        self._show()

    def _step(self, dt: float) -> None:
        control = self._control.value
        if control != self._previous_control or self.state is not _ENABLED or self.torque_off:
            self._obey(control)
        axis = self.axis
        mode = self._mode = self._wanted_mode.value
        if self.state is not _ENABLED:
            axis.move(0.0, dt)
            self._demand = axis.position
            self._recent.clear()
        elif mode == CYCLIC_SYNCHRONOUS_TORQUE:
            axis.push(self.objects[0x6071] / 1000.0, dt)
            self._demand = axis.position
        elif mode == HOMING:
            self._home(dt)
        else:
            self._interpolate(dt)
            axis.move((self._demand - axis.position) / axis.lag_s, dt)
        if mode == CYCLIC_SYNCHRONOUS_POSITION:
            self._watch_error(abs(self._demand - axis.position), dt)
        low, high = axis.travel
        if not low < axis.position < high and self.state is _ENABLED and mode != HOMING:
            self.fault(LIMIT_SWITCH)

    def _show(self) -> None:
        """Put what the axis does into the objects."""
        axis, place = self.axis, self.axis.position
        bits = STATUS_BITS[self.state] | 0x0210
        if self._mode == HOMING:
            bits |= 0x1400 if self.homed and not self._homing else 0
        elif self.state is _ENABLED:
            bits |= 0x1000
        low, high = axis.travel
        status, mode, position, speed, error, inputs = self._shown
        status.value, mode.value = bits, self._mode
        position.value, speed.value = round(place + axis.origin), round(axis.speed)
        error.value = round(self._demand - place)
        inputs.value = (place <= low) | (place >= high) << 1
        self.objects[0x6077] = self.objects[0x6071]

    def _home(self, dt: float) -> None:
        """Move to the switch that the method names; the place it closes at is known."""
        axis, start = self.axis, bool(self.objects[0x6040] & 0x10)
        way = HOMING_METHODS.get(self.objects[0x6098])
        if start and not self._started:
            if way is None:
                self.fault(HOMING_FAILED)
            else:
                self._homing, self.homed = True, False
        self._started = start
        self._homing = self._homing and start
        low, high = axis.travel
        if not self._homing:
            axis.move(0.0, dt)
        elif way and low < axis.position < high:
            axis.move(way * float(self.objects.entry(0x6099, 1).value), dt)
        else:
            axis.speed = 0.0
            axis.origin = self.objects[0x607C] - round(axis.position)
            axis.position -= (way or 0) * OFF_SWITCH
            self._homing, self.homed = False, True
        self._demand, self._left_s = axis.position, 0.0

    def _obey(self, control: int) -> None:
        """Follow the control word (CiA 402-2, transitions 2 to 16)."""
        previous, self._previous_control = self._previous_control, control
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
            gap = self.objects[0x607A] - self.axis.position - self.axis.origin
            if self.objects[0x6060] == CYCLIC_SYNCHRONOUS_POSITION and abs(gap) > window:
                self.fault(FOLLOWING_ERROR)  # a real drive would jump, or trip
        elif command & 7 == 6 and state in (State.SWITCHED_ON, State.OPERATION_ENABLED):
            self.state = State.READY_TO_SWITCH_ON
        elif command == 7 and state == State.OPERATION_ENABLED:
            self.state = State.SWITCHED_ON

    def _interpolate(self, dt: float) -> None:
        """Go to the last target within the interpolation time, no faster than allowed."""
        if self._fresh:
            self._fresh = False
            low, high, period, exponent, wanted = (entry.value for entry in self._interpolation)
            target = min(max(wanted, low), high) - self.axis.origin
            self._measure(wanted)
            time_s = period * 10.0**exponent
            limit = self.axis.speed_limit
            self._pace = min(max((target - self._demand) / time_s, -limit), limit)
            self._left_s = time_s
        part = min(dt, self._left_s)
        self._demand += self._pace * part
        self._left_s -= part

    def _measure(self, target: int) -> None:
        """Keep the largest change between two steps of the setpoint [increments]."""
        recent = self._recent
        recent.append(target)
        if len(recent) > 2:
            change = abs(recent[0] - 2 * recent[1] + recent[2])
            del recent[0]
            if change > self.largest_change:
                self.largest_change = change

    def _watch_error(self, error: float, dt: float) -> None:
        if error <= self._window.value or self.state is not _ENABLED:
            self._outside_s = 0.0
            return
        self._outside_s += dt
        if self._outside_s * 1000 >= self._patience.value:
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
            (0x6064, "i", round(self.axis.position + self.axis.origin), False),
            (0x6065, "I", 1000, True),
            (0x6066, "H", 20, True),
            (0x606C, "i", 0, False),
            (0x6071, "h", 0, True),
            (0x6077, "h", 0, False),
            (0x607A, "i", round(self.axis.position + self.axis.origin), True),
            (0x607C, "i", 0, True),
            (0x6098, "b", 0, True),
            (0x609A, "I", 1_000_000, True),
            (0x60F4, "i", 0, False),
            (0x60FD, "I", 0, False),
        ):
            objects.add(index, form, value, writable=writable)
        objects.add_list(0x607D, "i", [low, high])
        objects.add(0x60C2, "B", 2, writable=False)
        objects.add(0x60C2, "B", 2, sub=1)
        objects.add(0x60C2, "b", -3, sub=2)
        objects.add_list(0x60FE, "I", [0, 0])
        objects.add_list(0x6099, "I", [20_000, 2_000])
        objects.add_list(0x10F1, "I", [1, 0])
        objects.add_list(0x1C32, "H", [0])


def _layout(items: list[Entry | int]) -> tuple[list[Entry], struct.Struct]:
    """Entries of a mapping, and how they lie in the bytes; gaps are left out."""
    forms = "".join(f"{item}x" if isinstance(item, int) else item.form for item in items)
    entries = [item for item in items if not isinstance(item, int)]
    return entries, struct.Struct("<" + forms)
