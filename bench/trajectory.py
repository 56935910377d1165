# SPDX-License-Identifier: Apache-2.0
"""Joint trajectories of domes on two robots: what they keep, against other programs, then time.

The nozzle's place at the samples and between them comes from pinocchio, which the planner
does not use; durations from toppra.

Run: python bench/trajectory.py [--json FILE]
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import time
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np

from vega_planner.datatypes import PrintTrajectory, ToolpathSet
from vega_planner.robot import load_cell
from vega_planner.robot.workcell import Workcell
from vega_planner.settings import CellSettings, ToolpathSettings, TrajectorySettings
from vega_planner.toolpaths import lay_toolpaths
from vega_planner.trajectory import checks, make_trajectory
from vega_planner.trajectory.joint_path import joint_path
from vega_planner.trajectory.make_trajectory import PATH_TOLERANCE, path_solver
from vega_planner.trajectory.time_law import time_segment
from vega_planner.trajectory.waypoints import waypoints_of

TESTS = Path(__file__).parents[1] / "test"
#: Places between two samples at which pinocchio is asked.
PLACES = (0.0, 0.25, 0.5, 0.75)
#: Samples that pinocchio is asked about, at most, and those toppra times.
MOST, TIMED = 60_000, 12_000
RUNS = 5


def load(name: str, path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def nozzle_by_pinocchio(cell: Workcell, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tips [mm] and axes in the part frame."""
    import pinocchio

    model = pinocchio.buildModelFromXML(cell.robot.urdf)
    data, frame = model.createData(), model.getFrameId("tip")
    joints = [model.joints[model.getJointId(name)] for name in cell.robot.joint_names]
    full = pinocchio.neutral(model)
    points, axes = np.empty((len(q), 3)), np.empty((len(q), 3))
    for n, row in enumerate(q):
        for joint, value in zip(joints, row):
            if joint.nq == 2:
                full[joint.idx_q : joint.idx_q + 2] = np.cos(value), np.sin(value)
            else:
                full[joint.idx_q] = value
        pinocchio.framesForwardKinematics(model, data, full)
        points[n] = data.oMf[frame].translation
        axes[n] = data.oMf[frame].rotation[:, 2]
    return cell.to_part(points, axes)


def off_the_path(
    trajectory: PrintTrajectory, toolpaths: ToolpathSet, cell: Workcell
) -> dict[str, float]:
    """Tip and axis off the passes while printing, at samples and between them."""
    bead = np.flatnonzero(trajectory.extrude[1:])
    bead = bead[:: max(1, len(bead) * len(PLACES) // MOST)]
    owner = trajectory.path_id[1:][bead]
    tip, axis, asked = 0.0, 0.0, 0
    length = [
        np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p.points, axis=0), axis=1))])
        for p in toolpaths.passes
    ]
    known, _ = cell.to_part(*cell.robot.forward(trajectory.positions))
    step = np.linalg.norm(np.diff(known, axis=0), axis=1)
    walked = np.concatenate([[0.0], np.cumsum(np.where(trajectory.extrude[1:], step, 0.0))])
    for place in PLACES:
        q, _, _ = checks.joint_states(trajectory, place)
        points, axes = nozzle_by_pinocchio(cell, q[bead])
        asked += len(points)
        for k in np.unique(owner).tolist():
            path, mine = toolpaths.passes[k], owner == k
            tip = max(tip, float(checks._distances(points[mine], path.points).max()))
            first = np.flatnonzero(trajectory.path_id == k)[0]
            at = walked[bead[mine]] + place * step[bead[mine]] - walked[first]
            wanted = np.column_stack([np.interp(at, length[k], path.axes[:, c]) for c in range(3)])
            wanted /= np.linalg.norm(wanted, axis=1, keepdims=True)
            half = 0.5 * np.linalg.norm(wanted - axes[mine], axis=1)
            axis = max(axis, float(np.degrees(2 * np.arcsin(half)).max()))
    return {"tip_off_um": 1000 * tip, "axis_off_deg": axis, "asked": asked}


def quality(
    trajectory: PrintTrajectory, toolpaths: ToolpathSet, cell: Workcell, speed: float
) -> dict[str, float]:
    return {
        "samples": len(trajectory.times),
        "duration_s": trajectory.duration_s,
        "steady_pct": 100 * checks.steady_ratio(trajectory, cell.robot, speed),
        "slow_samples": len(checks.slow_samples(trajectory, cell.robot, speed)),
        **off_the_path(trajectory, toolpaths, cell),
        "largest_step_rad": checks.largest_printing_step(trajectory, cell.robot),
        "limit_excess": checks.limit_excess(trajectory, cell.robot),
    }


def timed(runs: int, work, *given) -> tuple[float, float]:
    """Least CPU seconds and wall seconds of some runs."""
    rows = []
    for _ in range(runs):
        wall, cpu = time.perf_counter(), time.process_time()
        work(*given)
        rows.append((time.process_time() - cpu, time.perf_counter() - wall))
    return min(row[0] for row in rows), min(row[1] for row in rows)


def against_toppra(toolpaths: ToolpathSet, cell: Workcell, speed: float) -> dict[str, float]:
    """Duration of the longest pass by both, on the same joint path and the same limits."""
    law = load("time_law_oracle", TESTS / "trajectory" / "test_time_law.py")
    way = waypoints_of(toolpaths, cell)
    path = joint_path(way, cell.robot, path_solver(cell.robot, speed), PATH_TOLERANCE)
    way = path.way
    k = max(np.flatnonzero(way.path_id >= 0), key=lambda n: way.starts[n + 1] - way.starts[n])
    rows = slice(int(way.starts[k]), min(int(way.starts[k + 1]), int(way.starts[k]) + TIMED))
    s, q = way.path[rows] - way.path[rows.start], path.q[rows]
    robot = cell.robot
    hardest = np.tile(robot.acceleration, (len(s), 1))
    cpu = time.process_time()
    times, _, _ = time_segment(s, q, np.full(len(s), speed), robot.velocity, hardest)
    own = time.process_time() - cpu
    cpu = time.process_time()
    reference = law.toppra_duration(s, q, speed, robot.velocity, robot.acceleration)
    return {
        "points": len(s),
        "own_s": float(times[-1]),
        "toppra_s": reference,
        "difference_pct": 100 * (float(times[-1]) / reference - 1),
        "own_cpu_s": own,
        "toppra_cpu_s": time.process_time() - cpu,
    }


def against_toppra_on_waves() -> float:
    """Largest difference of the duration [%], on smooth paths bound by joints and by speed."""
    law = load("time_law_oracle", TESTS / "trajectory" / "test_time_law.py")
    worst = 0.0
    velocity, acceleration = np.full(5, 3.0), np.full(5, 20.0)
    for seed in range(4):
        s, q = law.wavy_path(3000, seed)
        for speed in (0.02, 0.5, 50.0):
            times, _, _ = time_segment(
                s, q, np.full(len(s), speed), velocity, np.tile(acceleration, (len(s), 1))
            )
            reference = law.toppra_duration(s, q, speed, velocity, acceleration)
            worst = max(worst, 100 * abs(times[-1] / reference - 1))
    return worst


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    make = load("toolpath_shapes", TESTS / "toolpaths" / "conftest.py").make.__wrapped__()
    settings = TrajectorySettings()
    speed = settings.speed_mm_s / 1000
    shells = make.nest(26.0, 18, 7000)
    jobs = {
        "vega5, 18 shells": ("vega5", shells),
        "vega5, dome 60": ("vega5", (make.dome(30.0, 60.0),)),
        "vega5, wavy": ("vega5", (make.wavy(),)),
        "ur5e, dome 60": ("ur5e", (make.dome(30.0, 60.0),)),
        "ur5e, 3 shells": ("ur5e", shells[-3:]),
    }
    table: dict[str, dict] = {}
    for name, (robot, patches) in jobs.items():
        cell = load_cell(CellSettings(robot=robot))
        stack = make.stack(patches)
        for pattern in ("contour", "zigzag") if "60" in name else ("contour",):
            laying = replace(ToolpathSettings(), pattern=pattern, skin_overlap_ratio=0.0)
            toolpaths = lay_toolpaths(patches, stack, cell, laying)
            trajectory = make_trajectory(toolpaths, cell, settings)
            row = quality(trajectory, toolpaths, cell, speed)
            runs = RUNS if robot == "vega5" else 2
            laid = timed(runs, lay_toolpaths, patches, stack, cell, laying)
            moved = timed(runs, make_trajectory, toolpaths, cell, settings)
            row |= {
                "paths_cpu_s": laid[0],
                "trajectory_cpu_s": moved[0],
                "wall_s": laid[1] + moved[1],
            }
            row["cpu_s_per_60000"] = (laid[0] + moved[0]) * 60_000 / len(trajectory.times)
            table[f"{name}, {pattern}"] = row
            print(
                f"{name:17s}{pattern:8s} {row['samples']:6d} samples,"
                f" steady {row['steady_pct']:.2f} %, tip off {row['tip_off_um']:.1f} um,"
                f" axis off {row['axis_off_deg']:.2f} deg ({row['asked']} places),"
                f" step {row['largest_step_rad']:.3f} rad, excess {row['limit_excess']:.3f};"
                f" paths {1000 * laid[0]:.0f} + trajectory {1000 * moved[0]:.0f} ms CPU"
                f" ({1000 * row['cpu_s_per_60000']:.0f} for 60,000),"
                f" {1000 * row['wall_s']:.0f} ms wall",
                flush=True,
            )
    toolpaths = lay_toolpaths(shells, make.stack(shells), cell, ToolpathSettings())
    for robot in ("vega5", "ur5e"):
        cell = load_cell(CellSettings(robot=robot))
        last = (toolpaths.passes[-1],)
        ends = (toolpaths.travels[-2], toolpaths.travels[-1])
        row = against_toppra(ToolpathSet(last, ends), cell, speed)
        table[f"time law, {robot}"] = row
        print(
            f"time law, {robot}: {row['points']} points, {row['own_s']:.3f} s, toppra"
            f" {row['toppra_s']:.3f} s: {row['difference_pct']:+.4f} %;"
            f" {1000 * row['own_cpu_s']:.1f} ms, toppra {1000 * row['toppra_cpu_s']:.0f} ms"
        )
    worst = against_toppra_on_waves()
    table["time law, waves"] = {"largest_difference_pct": worst}
    print(f"time law, smooth paths bound by joints: at most {worst:.4f} % off toppra")
    if options.json:
        options.json.write_text(json.dumps(table, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
