# SPDX-License-Identifier: Apache-2.0
"""The joint trajectory of whole jobs: exact tip, steady speed, limits, order of events."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vega_planner.datatypes import ToolpathSet
from vega_planner.errors import Cancelled, InvalidInput, Unreachable
from vega_planner.robot import place
from vega_planner.settings import TrajectorySettings
from vega_planner.trajectory import make_trajectory
from vega_planner.trajectory.checks import (
    deviation,
    largest_printing_step,
    limit_excess,
    slow_samples,
    steady_ratio,
)

from .shapes import dome_lines, dome_spiral, line, pass_of, with_travels

SETTINGS = TrajectorySettings()
JOBS = {
    "spiral": lambda: with_travels([dome_spiral()]),
    "steep_spiral": lambda: with_travels([dome_spiral(rim_deg=72.0)]),
    "lines": lambda: with_travels([dome_lines(), dome_lines(offset=0.4, spacing=2.0)]),
    "coarse_corners": lambda: with_travels(
        [line([[-20, -20, 1], [20, -20, 1], [20, 20, 1], [-20, 20, 1], [-20, -15, 1]])]
    ),
    "there_and_back": lambda: with_travels([line([[-10, 0, 1], [10, 0, 1], [-10, 0, 1]])]),
}


@pytest.fixture(params=JOBS, scope="module")
def job(request, vega5):
    toolpaths = JOBS[request.param]()
    return request.param, toolpaths, make_trajectory(toolpaths, vega5, SETTINGS)


def test_the_tip_stays_on_its_path_between_samples(job, vega5):
    _, toolpaths, trajectory = job
    for curve in ("cubic", "linear"):
        off = deviation(trajectory, toolpaths, vega5, curve)
        assert off.tip_mm <= 0.010
        assert off.axis_rad <= np.radians(0.4)


def test_no_limit_is_exceeded_anywhere(job, vega5):
    assert limit_excess(job[2], vega5.robot) <= 0.0


def test_differences_of_samples_keep_the_limits_too(job, vega5):
    trajectory, robot = job[2], vega5.robot
    h = np.diff(trajectory.times)[:, None]
    speed = np.diff(trajectory.positions, axis=0) / h
    assert (np.abs(speed) <= robot.velocity).all()
    change = 2 * np.diff(speed, axis=0) / (h[1:] + h[:-1])
    assert (np.abs(change) <= robot.acceleration).all()


def test_the_tip_keeps_the_set_speed(job, vega5):
    _, _, trajectory = job
    steady = steady_ratio(trajectory, vega5.robot, 0.005)
    assert steady >= 0.995
    assert 1.0 - steady == pytest.approx(trajectory.slow_ratio, abs=2e-3)


def test_joints_make_no_large_steps_while_printing(job, vega5):
    assert largest_printing_step(job[2], vega5.robot) <= 0.2


def test_every_sample_of_a_pass_has_its_number_and_travel_has_none(job):
    _, toolpaths, trajectory = job
    runs = trajectory.path_id[np.concatenate([[True], np.diff(trajectory.path_id) != 0])]
    wanted = [-1]
    for k in range(len(toolpaths.passes)):
        wanted += [k, -1]
    assert runs.tolist() == wanted


def test_beads_are_laid_from_the_second_sample_of_each_pass_on(job):
    trajectory = job[2]
    first = np.concatenate([[True], np.diff(trajectory.path_id) != 0])
    assert (trajectory.extrude == ((trajectory.path_id >= 0) & ~first)).all()


def test_the_arm_rests_at_both_ends_of_every_pass(job):
    trajectory = job[2]
    change = np.diff(trajectory.path_id) != 0
    inside = trajectory.path_id >= 0
    starts = np.flatnonzero(np.concatenate([[False], change]) & inside)
    ends = np.flatnonzero(np.concatenate([change, [False]]) & inside)
    np.testing.assert_allclose(trajectory.velocities[[0, *starts, *ends, -1]], 0.0, atol=1e-12)


def test_printed_and_given_length_agree(job, vega5):
    _, toolpaths, trajectory = job
    points, _ = vega5.robot.forward(trajectory.positions)
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    printed = 1000 * step[trajectory.extrude[1:]].sum()
    assert printed == pytest.approx(toolpaths.path_length_mm, rel=1e-9)


def test_the_dispenser_is_switched_ahead_of_each_bead(job, vega5):
    _, toolpaths, trajectory = job
    inside = trajectory.path_id
    starts = np.array([trajectory.times[inside == k][0] for k in range(len(toolpaths.passes))])
    ends = np.array([trajectory.times[inside == k][-1] for k in range(len(toolpaths.passes))])
    material = vega5.material
    np.testing.assert_allclose(trajectory.dispensing[:, 0], starts - material.lead_s)
    np.testing.assert_allclose(trajectory.dispensing[:, 1], ends - material.lag_s)


def test_the_tip_waits_where_the_material_asks_for_it(vega5):
    toolpaths = JOBS["lines"]()
    plain = make_trajectory(toolpaths, vega5, SETTINGS)
    slow = replace(vega5.material, start_dwell_s=0.4, end_dwell_s=0.25)
    cell = replace(vega5, material=slow)
    waiting = make_trajectory(toolpaths, cell, SETTINGS)
    count = len(toolpaths.passes)
    assert waiting.duration_s == pytest.approx(plain.duration_s + count * 0.65)
    for k in range(count):
        rows = np.flatnonzero(waiting.path_id == k)
        first, last = int(rows[0]), int(rows[-1])
        for a, b, wait in ((first - 1, first, 0.4), (last, last + 1, 0.25)):
            assert waiting.times[b] - waiting.times[a] == pytest.approx(wait)
            np.testing.assert_array_equal(waiting.positions[a], waiting.positions[b])
            np.testing.assert_array_equal(waiting.velocities[[a, b]], 0.0)
        # pressure is on while it waits at the start, and off while it waits at the end
        on, off = waiting.dispensing[k]
        assert on == pytest.approx(waiting.times[first] - 0.4 - slow.lead_s)
        assert off == pytest.approx(waiting.times[last] - slow.lag_s)
        assert not waiting.extrude[[first - 1, first, last + 1]].any()
    assert limit_excess(waiting, cell.robot) <= 0.0


def test_the_same_job_gives_the_same_bytes(vega5):
    toolpaths = JOBS["lines"]()
    first, again = (make_trajectory(toolpaths, vega5, SETTINGS) for _ in range(2))
    for name in ("times", "positions", "velocities", "extrude", "path_id", "dispensing"):
        assert getattr(first, name).tobytes() == getattr(again, name).tobytes()


def test_it_begins_at_the_start_of_the_first_travel(job, vega5):
    _, toolpaths, trajectory = job
    points, axes = vega5.robot.forward(trajectory.positions[:1])
    start, axis = vega5.to_base(toolpaths.travels[0].points[:1], toolpaths.travels[0].axes[:1])
    np.testing.assert_allclose(points, start, atol=1e-9)
    np.testing.assert_allclose(axes, axis, atol=1e-9)
    assert trajectory.times[0] == 0.0


def test_travel_is_as_fast_as_set_and_exact(vega5):
    passes = [line([[-40, -20, 1], [-30, -20, 1]]), line([[40, 30, 1], [30, 30, 1]])]
    toolpaths = with_travels(passes)
    trajectory = make_trajectory(toolpaths, vega5, SETTINGS)
    points, _ = vega5.robot.forward(trajectory.positions)
    step = np.linalg.norm(np.diff(points, axis=0), axis=1)
    speed = step / np.diff(trajectory.times)
    assert speed.max() == pytest.approx(0.040, rel=1e-6)
    assert np.median(speed[trajectory.path_id[1:] < 0]) > 0.03
    fast = make_trajectory(toolpaths, vega5, replace(SETTINGS, travel_speed_mm_s=400.0))
    assert fast.duration_s < trajectory.duration_s - 1.0
    assert limit_excess(fast, vega5.robot) <= 0.0


def test_a_faster_print_takes_less_time_and_keeps_the_limits(vega5):
    toolpaths = JOBS["spiral"]()
    slow = make_trajectory(toolpaths, vega5, SETTINGS)
    fast = make_trajectory(toolpaths, vega5, replace(SETTINGS, speed_mm_s=50.0))
    assert fast.duration_s < 0.15 * slow.duration_s
    assert limit_excess(fast, vega5.robot) <= 0.0
    assert deviation(fast, toolpaths, vega5).tip_mm <= 0.010


def test_too_fast_a_print_is_slowed_by_the_joints_and_told(vega5):
    toolpaths = JOBS["lines"]()
    trajectory = make_trajectory(toolpaths, vega5, replace(SETTINGS, speed_mm_s=300.0))
    assert limit_excess(trajectory, vega5.robot) <= 0.0
    assert trajectory.slow_ratio > 0.05
    assert any("too slow" in text for text in trajectory.warnings)
    assert len(slow_samples(trajectory, vega5.robot, 0.3))


def test_a_turned_and_moved_part_is_printed_in_the_same_time(vega5):
    toolpaths = JOBS["spiral"]()
    moved = place(vega5, (12.0, -7.0, 0.0, 50.0))
    here, there = (make_trajectory(toolpaths, cell, SETTINGS) for cell in (vega5, moved))
    assert there.duration_s == pytest.approx(here.duration_s, rel=2e-3)
    assert deviation(there, toolpaths, moved).tip_mm <= 0.010


def test_axes_that_turn_on_the_spot_are_followed_on_travel(vega5):
    first = line([[-10, 0, 1], [0, 0, 1]])
    tilted = pass_of([[5, 0, 1], [15, 0, 1]], [[0.5, 0, 1], [0.5, 0, 1]])
    toolpaths = with_travels([first, tilted])
    trajectory = make_trajectory(toolpaths, vega5, SETTINGS)
    assert limit_excess(trajectory, vega5.robot) <= 0.0


def test_repeated_points_do_no_harm(vega5):
    path = dome_spiral()
    twice = pass_of(np.repeat(path.points, 2, axis=0), np.repeat(path.axes, 2, axis=0))
    plain = make_trajectory(with_travels([path]), vega5, SETTINGS)
    repeated = make_trajectory(with_travels([twice]), vega5, SETTINGS)
    assert repeated.duration_s == pytest.approx(plain.duration_s, rel=1e-9)


def test_an_unreachable_pose_is_named(vega5):
    toolpaths = with_travels([line([[0, 0, 1], [400, 0, 1]])])
    with pytest.raises(Unreachable, match="pass 0") as error:
        make_trajectory(toolpaths, vega5, SETTINGS)
    assert error.value.waypoint >= 0
    assert "\n" not in str(error.value)


def test_a_travel_that_misses_its_pass_is_refused(vega5):
    good = JOBS["spiral"]()
    moved = replace(good.travels[0], points=good.travels[0].points + 1.0)
    bad = ToolpathSet(good.passes, (moved, good.travels[1]))
    with pytest.raises(InvalidInput, match="travel 0 misses"):
        make_trajectory(bad, vega5, SETTINGS)


def test_missing_passes_and_travels_are_refused(vega5):
    good = JOBS["spiral"]()
    with pytest.raises(InvalidInput, match="no toolpath"):
        make_trajectory(ToolpathSet((), good.travels[:1]), vega5, SETTINGS)
    with pytest.raises(InvalidInput, match="1 travels for 1 passes"):
        make_trajectory(ToolpathSet(good.passes, good.travels[:1]), vega5, SETTINGS)


def test_the_job_can_be_cancelled_in_the_middle(vega5):
    def report(progress):
        if progress.fraction > 0.5:
            raise Cancelled("stop")

    with pytest.raises(Cancelled):
        make_trajectory(JOBS["spiral"](), vega5, SETTINGS, report)


def test_progress_rises_from_nothing_to_all(vega5):
    seen = []
    make_trajectory(JOBS["spiral"](), vega5, SETTINGS, lambda p: seen.append(p.fraction))
    assert seen == sorted(seen)
    assert (seen[0], seen[-1]) == (0.0, 1.0)
