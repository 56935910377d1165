# SPDX-License-Identifier: Apache-2.0
"""Every exported file, read back, is the trajectory it was written from."""

from __future__ import annotations

import json

import numpy as np
import pytest

from vega_planner.datatypes import Toolpath, ToolpathSet, Travel
from vega_planner.errors import InvalidInput
from vega_planner.export import export_plan
from vega_planner.export.csv_table import read_csv, write_csv
from vega_planner.export.gcode import axis_letters, read_gcode, write_gcode
from vega_planner.export.job import job_of, read_result
from vega_planner.export.urscript import read_urscript, write_urscript
from vega_planner.results.tables import trajectory_csv
from vega_planner.settings import TrajectorySettings
from vega_planner.trajectory import make_trajectory


def two_arcs():
    """Two passes over a sphere with travels between, in the part frame."""
    passes, travels, above = [], [], np.array([0.0, 0.0, 50.0])
    last = None
    for y in (-6.0, 5.0):
        x = np.arange(-15, 15.01, 0.5)
        flat = np.column_stack([x, np.full_like(x, y)])
        z = np.sqrt(900 - (flat**2).sum(1))
        points, axes = np.column_stack([flat, z - 14]), np.column_stack([flat, z]) / 30
        n = len(x)
        passes.append(Toolpath(points, axes, np.full(n, 1.2), np.full(n, 0.8), 0, 0))
        start, lifted = (above, points[0] + 8 * axes[0])
        if last is None:
            travels.append(Travel([start, lifted, points[0]], [[0, 0, 1], axes[0], axes[0]]))
        else:
            up = last.points[-1] + 8 * last.axes[-1]
            travels.append(
                Travel(
                    [last.points[-1], up, lifted, points[0]],
                    [last.axes[-1], last.axes[-1], axes[0], axes[0]],
                )
            )
        last = passes[-1]
    travels.append(Travel([last.points[-1], above], [last.axes[-1], [0, 0, 1]]))
    return ToolpathSet(tuple(passes), tuple(travels))


@pytest.fixture(scope="module")
def gantry_job(vega5):
    trajectory = make_trajectory(two_arcs(), vega5, TrajectorySettings())
    return trajectory, job_of(trajectory, vega5.robot, "two arcs (test) 100%")


@pytest.fixture(scope="module")
def arm_job(ur5e):
    trajectory = make_trajectory(two_arcs(), ur5e, TrajectorySettings())
    return trajectory, job_of(trajectory, ur5e.robot, "two arcs")


def assert_same(back, job, length, angle, time):
    linear = ~job.robot.chain.revolute
    np.testing.assert_allclose(back.times, job.times, rtol=0, atol=time)
    off = np.abs(back.positions - job.positions)
    assert off[:, ~linear].max(initial=0.0) <= angle
    assert off[:, linear].max(initial=0.0) <= length
    for name in ("valve", "extrude", "path_id"):
        np.testing.assert_array_equal(getattr(back, name)[1:], getattr(job, name)[1:])


@pytest.mark.parametrize("kind", ["tip", "joints"])
def test_gcode_reads_back_as_the_trajectory(gantry_job, kind):
    trajectory, job = gantry_job
    back = read_gcode(write_gcode(job, kind), job.robot, trajectory.T_base_part)
    # the tip's lever turns a rounded angle into a rounded length
    assert_same(back, job, length=1.5e-8, angle=1e-8, time=1e-6)


def test_gcode_tip_words_are_the_toolpaths_points(gantry_job):
    _, job = gantry_job
    text = write_gcode(job, "tip")
    blocks = [line for line in text.splitlines() if line.startswith("G1")]
    xyz = np.array([[float(word[1:]) for word in line.split()[1:4]] for line in blocks])
    inside = job.extrude[1:]
    for path, k in ((p, i) for i, p in enumerate(two_arcs().passes)):
        mine = xyz[inside & (job.path_id[1:] == k)]
        middle = mine[np.abs(mine[:, 0]) < 14]
        height = np.sqrt(900 - middle[:, 0] ** 2 - middle[:, 1] ** 2) - 14
        np.testing.assert_allclose(middle[:, 1], path.points[0, 1], atol=1e-5)
        np.testing.assert_allclose(middle[:, 2], height, atol=1.2e-3)


def test_gcode_blocks_take_their_time(gantry_job):
    _, job = gantry_job
    feeds = [
        float(line.split("F")[1])
        for line in write_gcode(job, "joints").splitlines()
        if line.startswith("G1")
    ]
    np.testing.assert_allclose(60.0 / np.array(feeds), np.diff(job.times), rtol=1e-9)


def test_gcode_names_axes_after_what_they_turn_about(vega5, gantry):
    assert axis_letters(vega5.robot) == ("A", "B")
    assert axis_letters(gantry().robot) == ("C", "B")


def test_urscript_reads_back_as_the_trajectory(arm_job):
    _, job = arm_job
    back = read_urscript(write_urscript(job), job.joint_names)
    assert_same(back, job, length=0, angle=5.1e-10, time=1e-6)


@pytest.mark.parametrize("which", ["gantry_job", "arm_job"])
def test_csv_reads_back_as_the_trajectory(which, request, tmp_path):
    _, job = request.getfixturevalue(which)
    path = tmp_path / "job.csv"
    path.write_text(write_csv(job))
    back = read_csv(path)
    assert back.joint_names == job.joint_names
    assert_same(back, job, length=5.1e-10, angle=5.1e-10, time=5.1e-10)
    np.testing.assert_allclose(back.velocities, job.velocities, rtol=0, atol=5.1e-10)


def test_a_job_holds_the_trajectory_and_a_sample_at_every_switching(gantry_job):
    trajectory, job = gantry_job
    kept = np.isin(job.times, trajectory.times)
    np.testing.assert_array_equal(job.positions[kept], trajectory.positions)
    np.testing.assert_array_equal(job.path_id[kept], trajectory.path_id)
    change = np.flatnonzero(np.diff(job.valve.astype(int)))
    np.testing.assert_allclose(job.times[change], trajectory.dispensing.ravel(), atol=1e-12)


def test_each_file_ends_with_the_dispenser_off(gantry_job, arm_job):
    for text, off in (
        (write_gcode(gantry_job[1], "tip"), "M65 P0"),
        (write_urscript(arm_job[1]), "set_standard_digital_out(0, False)"),
    ):
        lines = [line.strip() for line in text.splitlines()]
        moves = [k for k, line in enumerate(lines) if line.startswith(("G1", "servoj"))]
        assert off in lines[moves[-1] :]
        assert off in lines[: moves[0]]


@pytest.fixture
def folder(tmp_path, gantry_job):
    trajectory, _ = gantry_job
    (tmp_path / "trajectory.csv").write_bytes(trajectory_csv(trajectory))
    summary = {
        "mesh": "arcs",
        "robot": "vega5",
        "material": "se1700",
        "T_base_part": trajectory.T_base_part.tolist(),
    }
    (tmp_path / "summary.json").write_text(json.dumps(summary))
    return tmp_path


def test_a_result_folder_is_exported_as_its_trajectory(folder, gantry_job):
    trajectory, job = gantry_job
    path = export_plan(folder, "gcode")
    for name in (path, path.with_name("print_joints.gcode")):
        back = read_gcode(name.read_text(), job.robot, trajectory.T_base_part)
        at = np.searchsorted(back.times, trajectory.times - 1e-6)
        np.testing.assert_allclose(back.times[at], trajectory.times, atol=2e-6)
        np.testing.assert_allclose(back.positions[at], trajectory.positions, atol=2e-8)
        np.testing.assert_array_equal(back.path_id[at][1:], trajectory.path_id[1:])
    table = read_csv(export_plan(folder, "csv", folder / "other.csv"))
    np.testing.assert_allclose(read_result(folder).times, table.times, atol=1e-9)


def test_lead_and_lag_of_the_result_are_those_of_the_trajectory(folder, gantry_job):
    job = read_result(folder)
    change = np.flatnonzero(np.diff(job.valve.astype(int)))
    np.testing.assert_allclose(job.times[change], gantry_job[0].dispensing.ravel(), atol=2e-9)


def test_a_robot_of_ones_own_is_named_on_the_command_line(gantry, machine_urdf, tmp_path, capsys):
    """A machine that is not one of config/robots: G-code, read back, is its trajectory."""
    from vega_planner.cli import main

    cell = gantry()
    trajectory = make_trajectory(two_arcs(), cell, TrajectorySettings())
    (tmp_path / "trajectory.csv").write_bytes(trajectory_csv(trajectory))
    summary = {
        "robot": "gantry", "material": "se1700", "T_base_part": trajectory.T_base_part.tolist()
    }  # fmt: skip
    (tmp_path / "summary.json").write_text(json.dumps(summary))
    words = ["export", str(tmp_path), "--format", "gcode"]
    assert main(words) == 2
    assert "name its description with --robot" in capsys.readouterr().err
    urdf = tmp_path / "own.urdf"
    urdf.write_text(machine_urdf())
    assert main([*words, "--robot", str(urdf)]) == 0
    for name in ("print.gcode", "print_joints.gcode"):
        text = (tmp_path / name).read_text()
        back = read_gcode(text, cell.robot, trajectory.T_base_part)
        at = np.searchsorted(back.times, trajectory.times - 1e-6)
        np.testing.assert_allclose(back.positions[at], trajectory.positions, atol=2e-8)
        points, _ = cell.robot.forward(back.positions[at])
        np.testing.assert_allclose(
            points, cell.robot.forward(trajectory.positions)[0], rtol=0, atol=2e-8
        )


def test_what_a_machine_cannot_take_is_refused_in_one_line(folder, arm_job, tmp_path):
    with pytest.raises(InvalidInput, match="six rotary joints"):
        export_plan(folder, "urscript")
    with pytest.raises(InvalidInput, match="three linear and two rotary"):
        write_gcode(arm_job[1], "tip")
    with pytest.raises(InvalidInput, match="choices: gcode, urscript, csv"):
        export_plan(folder, "pdf")
    with pytest.raises(InvalidInput, match="has no trajectory"):
        export_plan(tmp_path / "nothing", "csv")
    with pytest.raises(InvalidInput, match="has the joints"):
        export_plan(folder, "csv", robot="ur5e")
    with pytest.raises(InvalidInput, match="is a folder"):
        export_plan(folder, "csv", folder)
    (folder / "summary.json").write_text("[")
    with pytest.raises(InvalidInput, match="cannot be read"):
        export_plan(folder, "csv")


def test_a_damaged_file_is_refused_with_its_line(gantry_job, arm_job):
    trajectory, job = gantry_job
    text = write_gcode(job, "tip").replace(" F", " Q", 1)
    with pytest.raises(InvalidInput, match="line"):
        read_gcode(text, job.robot, trajectory.T_base_part)
    script = write_urscript(arm_job[1]).replace("servoj([", "servoj(", 1)
    with pytest.raises(InvalidInput, match="line"):
        read_urscript(script, arm_job[1].joint_names)


def test_nothing_is_left_half_written(folder):
    before = sorted(path.name for path in folder.iterdir())
    export_plan(folder, "csv")
    assert sorted(path.name for path in folder.iterdir()) == sorted([*before, "print.csv"])
