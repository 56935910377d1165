# SPDX-License-Identifier: Apache-2.0
"""G-code for machines with three linear and two rotary axes, written and read back.

Two kinds: `tip` gives the tip in the part frame (the work offset) and the rotary axes, for
controllers that keep the tip on its line themselves (G43.4); `joints` gives every axis as
the motors take it. Millimetres and degrees; inverse time feed (G93), so that each block
takes its own time whatever the axes do. M62 and M63 switch the dispenser with the motion
of the block that follows.
"""

from __future__ import annotations

import re

import numpy as np

from vega_planner.datatypes import Floats
from vega_planner.errors import InvalidInput
from vega_planner.export.job import ExportJob
from vega_planner.robot.robot import Robot
from vega_planner.units import m_to_mm, mm_to_m

#: Digits after the point: 10 nm and 2e-8 rad.
LENGTH_DIGITS, ANGLE_DIGITS = 5, 6
_WORD = re.compile(r"([A-Z])([-+]?[0-9.]+(?:e[-+]?\d+)?)")


def axis_letters(robot: Robot) -> tuple[str, str]:
    """Letters of the two rotary axes: A, B or C by the direction each is nearest to.

    Raises:
        InvalidInput: If the machine is not one of three linear and two rotary axes.
    """
    if robot.closed_form is None:
        raise InvalidInput(
            f"G-code is for machines with three linear and two rotary axes; robot "
            f"'{robot.name}' has the joints {', '.join(robot.joint_names)}; choose csv"
            + (" or urscript" if robot.chain.revolute.all() else "")
        )
    first, second = (int(np.argmax(np.abs(robot.closed_form.geometry[k]))) for k in (1, 2))
    return ("ABC"[first], "ABC"[second]) if first != second else ("A", "B")


def write_gcode(job: ExportJob, kind: str) -> str:
    """Write a job.

    Args:
        job: The job.
        kind: "tip" or "joints".

    Raises:
        InvalidInput: If the machine is not one of three linear and two rotary axes.
    """
    robot = job.known_robot()
    letters = axis_letters(robot)
    linear = job.tip_in_part()[0] if kind == "tip" else m_to_mm(job.positions[:, :3])
    angles = np.degrees(job.positions[:, 3:])
    words = _words(linear, angles, letters)
    lines = [
        "%",
        f"({_plain(job.title) or 'job'})",
        f"({'tip in the part frame' if kind == 'tip' else 'axis positions'}; mm, degrees)",
        "G21 G90",
        "M65 P0",
        *(["G43.4 H1"] if kind == "tip" else []),
        f"G0 {words[0]}",
        "G93",
    ]
    minutes = np.diff(job.times) / 60.0
    valve, owner = False, None
    for k in range(1, len(words)):
        if job.path_id[k] != owner:
            owner = job.path_id[k]
            lines.append(f"(pass {owner})" if owner >= 0 else "(travel)")
        if job.valve[k] != valve:
            valve = bool(job.valve[k])
            lines.append("M62 P0" if valve else "M63 P0")
        lines.append(f"G1 {words[k]} F{1.0 / minutes[k - 1]:.10g}")
    lines += ["M65 P0", "G94", *(["G49"] if kind == "tip" else []), "M2", "%"]
    return "\n".join(lines) + "\n"


def _words(linear: Floats, angles: Floats, letters: tuple[str, str]) -> list[str]:
    pattern = " ".join(
        [f"{letter}{{:.{LENGTH_DIGITS}f}}" for letter in "XYZ"]
        + [f"{letter}{{:.{ANGLE_DIGITS}f}}" for letter in letters]
    )
    rows = np.hstack([linear, angles])
    digits = np.array([LENGTH_DIGITS] * 3 + [ANGLE_DIGITS] * 2)
    rows = np.round(rows * 10.0**digits) / 10.0**digits + 0.0  # no "-0.00000"
    return [pattern.format(*row) for row in rows.tolist()]


def _plain(text: str) -> str:
    return re.sub(r"[^ -~]|[()%]", " ", text)


def read_gcode(text: str, robot: Robot, T_base_part: Floats) -> ExportJob:
    """Read back what `write_gcode` wrote, of either kind.

    Args:
        text: The file.
        robot: The machine, to find its joints from tip positions.
        T_base_part: Pose of the part frame in the base, metres.

    Raises:
        InvalidInput: If the file has a block that is not understood.
    """
    letters = axis_letters(robot)
    tip = "G43.4" in text
    rows: list[list[float]] = []
    times, valves, owners = [0.0], [False], [-1]
    valve, owner = False, -1
    for number, line in enumerate(text.splitlines(), 1):
        code = line.strip()
        if code.startswith("(pass "):
            owner = int(code[6:-1])
        elif code == "(travel)":
            owner = -1
        elif code in ("M62 P0", "M63 P0", "M65 P0"):
            valve = code == "M62 P0"
        elif code.startswith(("G0 ", "G1 ")):
            words = dict(_WORD.findall(code))
            try:
                rows.append([float(words[letter]) for letter in ("X", "Y", "Z", *letters)])
                if code.startswith("G1 "):
                    times.append(times[-1] + 60.0 / float(words["F"]))
                    valves.append(valve)
                    owners.append(owner)
            except (KeyError, ValueError) as error:
                raise InvalidInput(f"G-code line {number} is not understood: {code}") from error
    table = np.array(rows)
    angles = np.radians(table[:, 3:])
    linear = mm_to_m(table[:, :3])
    if tip:
        points = linear @ T_base_part[:3, :3].T + T_base_part[:3, 3]
        linear = _linear_axes(robot, points, angles)
    owner_array = np.array(owners)
    first = np.concatenate([[True], np.diff(owner_array) != 0])
    positions = np.hstack([linear, angles])
    return ExportJob(
        joint_names=robot.joint_names,
        times=np.array(times),
        positions=positions,
        velocities=np.zeros_like(positions),
        valve=np.array(valves),
        extrude=(owner_array >= 0) & ~first,
        path_id=owner_array,
        T_base_part=T_base_part,
        robot=robot,
    )


def _linear_axes(robot: Robot, points: Floats, angles: Floats) -> Floats:
    """Positions of the linear axes that bring the tip to points at given rotary angles."""
    rest = np.hstack([np.zeros((len(points), 3)), angles])
    here, _ = robot.forward(rest)
    directions = (
        np.array([robot.forward(np.eye(5)[k : k + 1])[0][0] for k in range(3)])
        - robot.forward(np.zeros((1, 5)))[0]
    )
    return np.asarray((points - here) @ np.linalg.inv(directions))
