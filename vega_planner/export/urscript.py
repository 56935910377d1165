# SPDX-License-Identifier: Apache-2.0
"""URScript for arms with six rotary joints, written and read back.

Each sample is a `servoj` that lasts as long as the interval before it; the dispenser hangs
on standard digital output 0.
"""

from __future__ import annotations

import re

import numpy as np

from vega_planner.errors import InvalidInput
from vega_planner.export.job import ExportJob

#: Digits after the point: 1e-9 rad and 1 ns.
_DIGITS = 9
#: Speed and acceleration of the move to the first pose [rad/s, rad/s²].
_APPROACH_SPEED, _APPROACH_ACCELERATION = 0.25, 0.5
#: Look-ahead [s] and gain of the arm's position servo: the least smoothing it offers.
_LOOKAHEAD, _GAIN = 0.03, 2000
_SERVO = re.compile(r"servoj\(\[([^]]+)\], 0, 0, ([0-9.]+),")
_MOVE = re.compile(r"movej\(\[([^]]+)\]")


def write_urscript(job: ExportJob) -> str:
    """Write a job.

    Raises:
        InvalidInput: If the arm has not six rotary joints.
    """
    robot = job.robot
    turning = robot is None or bool(robot.chain.revolute.all())
    if len(job.joint_names) != 6 or not turning:
        raise InvalidInput(
            "URScript is for arms with six rotary joints; this result's joints are "
            f"{', '.join(job.joint_names)}; choose gcode or csv"
        )
    pattern = "[" + ", ".join([f"{{:.{_DIGITS}f}}"] * 6) + "]"
    joints = [pattern.format(*row) for row in (job.positions + 0.0).tolist()]
    lines = [
        f"# {' '.join(job.title.split())}",
        "def vega_print():",
        "  set_standard_digital_out(0, False)",
        f"  movej({joints[0]}, a={_APPROACH_ACCELERATION}, v={_APPROACH_SPEED})",
    ]
    valve, owner = False, None
    for k, step in enumerate(np.diff(job.times).tolist(), 1):
        if job.path_id[k] != owner:
            owner = job.path_id[k]
            lines.append(f"  # pass {owner}" if owner >= 0 else "  # travel")
        if job.valve[k] != valve:
            valve = bool(job.valve[k])
            lines.append(f"  set_standard_digital_out(0, {valve})")
        lines.append(f"  servoj({joints[k]}, 0, 0, {step:.{_DIGITS}f}, {_LOOKAHEAD}, {_GAIN})")
    lines += ["  set_standard_digital_out(0, False)", "  stopj(2.0)", "end", "vega_print()"]
    return "\n".join(lines) + "\n"


def read_urscript(text: str, joint_names: tuple[str, ...]) -> ExportJob:
    """Read back what `write_urscript` wrote.

    Raises:
        InvalidInput: If the file has a move that is not understood.
    """
    rows: list[list[float]] = []
    times, valves, owners = [0.0], [False], [-1]
    valve, owner = False, -1
    for number, line in enumerate(text.splitlines(), 1):
        code = line.strip()
        if code.startswith("# pass "):
            owner = int(code[7:])
        elif code == "# travel":
            owner = -1
        elif code.startswith("set_standard_digital_out(0, "):
            valve = code.endswith("True)")
        elif code.startswith(("movej", "servoj")):
            found = (_SERVO if code.startswith("servoj") else _MOVE).match(code)
            if found is None:
                raise InvalidInput(f"URScript line {number} is not understood: {code}")
            rows.append([float(word) for word in found.group(1).split(",")])
            if code.startswith("servoj"):
                times.append(times[-1] + float(found.group(2)))
                valves.append(valve)
                owners.append(owner)
    owner_array = np.array(owners)
    first = np.concatenate([[True], np.diff(owner_array) != 0])
    positions = np.array(rows)
    return ExportJob(
        joint_names=joint_names,
        times=np.array(times),
        positions=positions,
        velocities=np.zeros_like(positions),
        valve=np.array(valves),
        extrude=(owner_array >= 0) & ~first,
        path_id=owner_array,
    )
