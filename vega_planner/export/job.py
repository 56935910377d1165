# SPDX-License-Identifier: Apache-2.0
"""What a machine's controller is told: samples in time with the valve's state."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints, PrintTrajectory
from vega_planner.errors import InvalidInput, VegaError
from vega_planner.results.tables import read_table
from vega_planner.robot.material import load_material
from vega_planner.robot.robot import Robot, load_robot
from vega_planner.trajectory.dispensing import switching_times
from vega_planner.units import m_to_mm

#: Times nearer than this are one time [s].
_SAME_TIME = 1e-7


@dataclass(frozen=True, eq=False)
class ExportJob:
    """A joint trajectory whose valve changes at samples only.

    Attributes:
        joint_names: As in the URDF.
        times: Times [s], strictly rising, shape (n,).
        positions: Joint positions [m, rad], shape (n, j).
        velocities: Joint velocities [m/s, rad/s], shape (n, j).
        valve: True where the dispenser is on during the interval that ends at the sample,
            lead and lag included, shape (n,).
        extrude: True where a bead is laid during that interval, shape (n,).
        path_id: Pass of each sample, -1 on travel, shape (n,).
        T_base_part: Pose of the part frame in the base, metres.
        robot: The robot, where its description is at hand.
        title: A line for the head of a file.
    """

    joint_names: tuple[str, ...]
    times: Floats
    positions: Floats
    velocities: Floats
    valve: Bools
    extrude: Bools
    path_id: Ints
    T_base_part: Floats = field(default_factory=lambda: np.eye(4))
    robot: Robot | None = None
    title: str = ""

    def tip_in_part(self) -> tuple[Floats, Floats]:
        """Tip positions [mm] and nozzle axes in the part frame, each (n, 3).

        Raises:
            InvalidInput: If the robot's description is not at hand.
        """
        robot = self.known_robot()
        points, axes = robot.forward(self.positions)
        rotation, origin = self.T_base_part[:3, :3], self.T_base_part[:3, 3]
        return m_to_mm((points - origin) @ rotation), axes @ rotation

    def known_robot(self) -> Robot:
        """The robot.

        Raises:
            InvalidInput: If its description is not at hand.
        """
        if self.robot is None:
            raise InvalidInput(
                "the robot of this result is not one of config/robots, so that tip positions "
                "cannot be found; name its description with --robot"
            )
        return self.robot


def job_of(trajectory: PrintTrajectory, robot: Robot | None = None, title: str = "") -> ExportJob:
    """Make the samples of a job: those of the trajectory, and one at each switching.

    Args:
        trajectory: The trajectory.
        robot: The robot it was planned for, for tip positions.
        title: A line for the head of a file.
    """
    switches = trajectory.dispensing.ravel()
    times = trajectory.times
    near = np.clip(np.searchsorted(times, switches), 1, max(len(times) - 1, 1))
    closest = np.minimum(np.abs(times[near] - switches), np.abs(times[near - 1] - switches))
    extra = switches[(closest > _SAME_TIME) & (switches > times[0]) & (switches < times[-1])]
    all_times = np.unique(np.concatenate([times, extra]))
    after = np.clip(np.searchsorted(times, all_times), 0, len(times) - 1)
    positions, velocities = _hermite(trajectory, all_times)
    middle = 0.5 * (all_times[1:] + all_times[:-1])
    on = np.searchsorted(trajectory.dispensing[:, 0], middle, side="right")
    off = np.searchsorted(trajectory.dispensing[:, 1], middle, side="right")
    return ExportJob(
        joint_names=trajectory.joint_names,
        times=all_times,
        positions=positions,
        velocities=velocities,
        valve=np.concatenate([[False], on > off]),
        extrude=trajectory.extrude[after],
        path_id=trajectory.path_id[after],
        T_base_part=np.array(trajectory.T_base_part),
        robot=robot,
        title=title,
    )


def _hermite(trajectory: PrintTrajectory, times: Floats) -> tuple[Floats, Floats]:
    """Positions and velocities on the cubics between samples; exact at the samples."""
    t, q, v = trajectory.times, trajectory.positions, trajectory.velocities
    k = np.clip(np.searchsorted(t, times, side="right") - 1, 0, max(len(t) - 2, 0))
    h = (t[k + 1] - t[k])[:, None]
    w = (times - t[k])[:, None] / h
    m0, m1 = h * v[k], h * v[k + 1]
    b, c = 3 * (q[k + 1] - q[k]) - 2 * m0 - m1, 2 * (q[k] - q[k + 1]) + m0 + m1
    position = q[k] + w * (m0 + w * (b + w * c))
    velocity = (m0 + w * (2 * b + 3 * w * c)) / h
    last = w[:, 0] >= 1.0
    position[last], velocity[last] = q[k[last] + 1], v[k[last] + 1]
    return position, velocity


def read_result(folder: str | Path, robot: str | None = None) -> ExportJob:
    """Read the trajectory of a result folder.

    Args:
        folder: Result folder with `trajectory.csv` and `summary.json`.
        robot: Name or path of the robot; by default the one the summary names.

    Raises:
        InvalidInput: If the folder or a file is missing or wrong.
    """
    folder = Path(folder)
    if not (folder / "trajectory.csv").is_file():
        raise InvalidInput(f"result folder {folder} has no trajectory.csv; plan a part first")
    table = read_table(folder / "trajectory.csv", ("t_s", "extrude", "path_id"))
    names = tuple(name for name in table if name not in ("t_s", "extrude", "path_id"))
    summary = _summary(folder)
    times = table["t_s"]
    if len(times) < 2:
        raise InvalidInput(f"{folder / 'trajectory.csv'} has {len(times)} rows; at least 2")
    positions = np.column_stack([table[name] for name in names])
    if (folder / "velocities.csv").is_file():
        rates = read_table(folder / "velocities.csv", names)
        velocities = np.column_stack([rates[name] for name in names])
    else:
        velocities = np.gradient(positions, times, axis=0)
    path_id = table["path_id"].astype(np.int64)
    trajectory = PrintTrajectory(
        joint_names=names,
        times=times,
        positions=positions,
        velocities=velocities,
        extrude=table["extrude"] > 0.5,
        path_id=path_id,
        T_base_part=np.array(summary.get("T_base_part", np.eye(4).tolist())),
        dispensing=_switching(times, path_id, str(summary.get("material", ""))),
    )
    title = f"{summary.get('mesh', folder.name)}, {len(set(path_id.tolist()) - {-1})} passes"
    return job_of(trajectory, _robot(robot or str(summary.get("robot", "")), names, robot), title)


def _summary(folder: Path) -> dict[str, Any]:
    try:
        content = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InvalidInput(f"{folder / 'summary.json'} cannot be read: {error}") from error
    if not isinstance(content, dict):
        raise InvalidInput(f"{folder / 'summary.json'} holds no keys and values")
    return content


def _switching(times: Floats, path_id: Ints, material: str) -> Floats:
    """Switching times of the passes; without lead and lag where the material is not at hand."""
    passes = [np.flatnonzero(path_id == k) for k in sorted(set(path_id.tolist()) - {-1})]
    starts = np.array([times[rows[0]] for rows in passes])
    ends = np.array([times[rows[-1]] for rows in passes])
    try:
        known = load_material(material)
        return switching_times(starts - known.start_dwell_s, ends, known)
    except VegaError:
        return np.column_stack([starts, ends])


def _robot(spec: str, names: tuple[str, ...], asked: str | None) -> Robot | None:
    try:
        robot = load_robot(spec)
    except VegaError:
        if asked:
            raise
        return None
    if robot.joint_names != names:
        if asked:
            raise InvalidInput(
                f"robot '{spec}' has the joints {', '.join(robot.joint_names)}; the trajectory "
                f"has {', '.join(names)}"
            )
        return None
    return robot
