# SPDX-License-Identifier: Apache-2.0
"""The power state machine of a drive (CiA 402-2) as one table."""

from __future__ import annotations

from enum import Enum


class State(Enum):
    """State of a drive, with the words people use."""

    NOT_READY = "not ready to switch on"
    SWITCH_ON_DISABLED = "switch on disabled"
    READY_TO_SWITCH_ON = "ready to switch on"
    SWITCHED_ON = "switched on"
    OPERATION_ENABLED = "operation enabled"
    QUICK_STOP_ACTIVE = "quick stop active"
    FAULT_REACTION_ACTIVE = "fault reaction active"
    FAULT = "fault"


#: Status word bits that tell each state (the mask is 0x6F, and 0x4F where bit 5 is free).
STATUS_BITS = {
    State.NOT_READY: 0x00,
    State.SWITCH_ON_DISABLED: 0x40,
    State.READY_TO_SWITCH_ON: 0x21,
    State.SWITCHED_ON: 0x23,
    State.OPERATION_ENABLED: 0x27,
    State.QUICK_STOP_ACTIVE: 0x07,
    State.FAULT_REACTION_ACTIVE: 0x0F,
    State.FAULT: 0x08,
}
#: States without a free bit 5; the others are told by one bit less.
_WITH_QUICK_STOP_BIT = (
    State.READY_TO_SWITCH_ON,
    State.SWITCHED_ON,
    State.OPERATION_ENABLED,
    State.QUICK_STOP_ACTIVE,
)

#: Control word that leads from each state towards operation enabled; a fault is never left
#: on the way: it takes an explicit reset.
TOWARDS_ENABLED = {
    State.NOT_READY: 0x00,
    State.SWITCH_ON_DISABLED: 0x06,  # transition 2
    State.READY_TO_SWITCH_ON: 0x07,  # transition 3
    State.SWITCHED_ON: 0x0F,  # transition 4
    State.OPERATION_ENABLED: 0x0F,
    State.QUICK_STOP_ACTIVE: 0x00,  # transition 12
    State.FAULT_REACTION_ACTIVE: 0x00,
    State.FAULT: 0x00,
}
#: Modes of operation (object 6060).
HOMING_MODE, POSITION_MODE, TORQUE_MODE = 6, 8, 10
QUICK_STOP = 0x0B  # transition 11
DISABLE_VOLTAGE = 0x00  # transitions 7, 9, 10, 12
FAULT_RESET = 0x80  # transition 15, on the rising edge


def _told_by(bits: int) -> State:
    for state, wanted in STATUS_BITS.items():
        if bits & (0x6F if state in _WITH_QUICK_STOP_BIT else 0x4F) == wanted:
            return state
    return State.NOT_READY


#: The state that each value of the lower bits tells.
_STATES = tuple(_told_by(bits) for bits in range(0x80))


def state_of(status: int) -> State:
    """Read a drive's state out of its status word."""
    return _STATES[status & 0x7F]
