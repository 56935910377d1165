# SPDX-License-Identifier: Apache-2.0
"""What can be made to fail on an emulated line."""

from __future__ import annotations

from typing import TYPE_CHECKING

from vega_planner.errors import InvalidInput

if TYPE_CHECKING:
    from vega_robot_driver.emulators.segment import Segment

#: Fault of a drive without a cause of its own: over-current, as a number of the standard.
OVER_CURRENT = 0x7300
#: Faults and what their number means.
FAULTS = {
    "jam": "place of the drive whose axis is blocked",
    "torque_off": "place of the drive whose safe torque off opens",
    "emergency_stop": "nothing: safe torque off of all drives opens",
    "drive_fault": "place of the drive that trips",
    "limit_switch": "place of the drive whose high limit switch closes",
    "unplug": "drives that the cable still reaches",
    "lose_frames": "frames that are lost",
    "wrong_counters": "cyclic frames that come back with a wrong working counter",
    "silence": "milliseconds without a frame from a frozen master",
    "none": "mend everything",
}


def parsed(fault: str) -> tuple[str, int]:
    """Read a fault and its number: `jam 0`, `torque_off 1`, `unplug 2`, `none`, ...

    Raises:
        InvalidInput: If it is not one of the faults.
    """
    kind, _, number = fault.partition(" ")
    if kind not in FAULTS or not (number or "0").isdigit():
        raise InvalidInput(f"fault '{fault}'; choices: {', '.join(FAULTS)}, and a number")
    return kind, int(number or 0)


def inject(segment: Segment, fault: str, number: int) -> None:
    """Let something fail."""
    drives = [slave.drive for slave in segment.slaves]
    if fault == "jam":
        drives[number].axis.jammed = True
    elif fault == "torque_off":
        drives[number].torque_off = True
    elif fault == "emergency_stop":
        for drive in drives:
            drive.torque_off = True
    elif fault == "drive_fault":
        drives[number].fault(OVER_CURRENT)
    elif fault == "limit_switch":
        axis = drives[number].axis
        axis.travel = (axis.travel[0], axis.position)
    elif fault == "unplug":
        segment.plugged = number
    elif fault == "lose_frames":
        segment.frames_to_lose = number
    elif fault == "wrong_counters":
        segment.counters_to_falsify = number
    elif fault == "none":
        segment.plugged = len(segment.slaves)
        for drive in drives:
            drive.axis.jammed = drive.torque_off = False
