# SPDX-License-Identifier: Apache-2.0
"""The executor on simulated axes: the path is kept, the dispenser is gated, prints survive."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicHermiteSpline

sys.path.insert(0, str(Path(__file__).parent))
from synthetic import JOINTS, LIMITS, zigzag_job

from vega_planner.errors import Busy, Faulted, InvalidInput, Refused
from vega_robot_driver.dispenser.simulated import SimulatedDispenser
from vega_robot_driver.executor import Executor
from vega_robot_driver.job import PrintJob
from vega_robot_driver.limits import Limits
from vega_robot_driver.motion.simulated import SimulatedMotion


def new_executor(job: PrintJob | None = None) -> Executor:
    lower, upper, velocity = (np.array(LIMITS[k]) for k in ("lower", "upper", "velocity"))
    start = zigzag_job(1).positions[0] if job is None else job.positions[0]
    motion = SimulatedMotion(JOINTS, lower, upper, velocity, start)
    executor = Executor(motion, SimulatedDispenser(), Limits(lower, upper, velocity))
    executor.dispenser.set_pressure(130e3)
    motion.open()
    executor.enable()
    return executor


def run_to_end(executor: Executor, log: list | None = None, most: int = 200_000) -> None:
    while executor.state in ("printing", "pausing", "stopping") and most > 0:
        executor.advance(1)
        most -= 1
        if log is not None:
            log.append((executor.u, executor.gate, executor.targets.copy()))


def on_spans(log: list) -> np.ndarray:
    """Path times at which the dispenser went on and off."""
    u = np.array([row[0] for row in log])
    gate = np.concatenate([[False], [row[1] for row in log], [False]])
    edges = np.flatnonzero(gate[1:] != gate[:-1])
    return u[np.minimum(edges, len(u) - 1)].reshape(-1, 2)


def test_dispenses_exactly_in_the_passes():
    job, executor, log = zigzag_job(4), new_executor(), []
    executor.load(job)
    executor.run()
    run_to_end(executor, log)
    assert executor.state == "done"
    assert executor.paths_done == 4
    assert np.abs(on_spans(log) - job.intervals()).max() <= 1.5 * executor.motion.dt


def test_lead_and_lag_move_the_dispenser_not_the_path():
    job, executor, log = zigzag_job(2), new_executor(), []
    executor.load(job, lead_s=0.05, lag_s=0.03)
    executor.run()
    run_to_end(executor, log)
    moved = on_spans(log) - job.intervals()
    assert np.abs(moved - [-0.05, -0.03]).max() <= 1.5 * executor.motion.dt


def test_pause_resume_and_override_do_not_leave_the_path():
    job, executor, log = zigzag_job(2), new_executor(), []
    executor.load(job)
    executor.run()
    for action in (executor.pause, executor.resume, lambda: setattr(executor, "override", 0.3)):
        for _ in range(700):
            executor.advance(1)
            log.append((executor.u, executor.gate, executor.targets.copy()))
        action()
    run_to_end(executor, log)
    assert executor.state == "done"
    path = CubicHermiteSpline(job.times, job.positions, job.velocities)
    for u, _, target in log[::17]:
        if u >= 0:
            assert np.abs(path(u) - target).max() < 1e-9


def test_setpoints_never_jump():
    job, executor, log = zigzag_job(2), new_executor(), []
    executor.load(job)
    executor.run()
    for action in (executor.pause, executor.resume, executor.pause, executor.resume):
        for _ in range(333):
            executor.advance(1)
            log.append((executor.u, executor.gate, executor.targets.copy()))
        action()
    run_to_end(executor, log)
    rows, dt = np.array([row[2] for row in log]), executor.motion.dt
    second = np.abs(np.diff(rows, 2, axis=0)).max(0) / dt**2
    assert (second[:3] < 1.0).all()  # m/s²


def test_pause_stands_within_its_ramp_and_resumes_in_place():
    executor = new_executor()
    executor.load(zigzag_job(2))
    executor.run()
    while executor.u < 2.0:
        executor.advance(1)
    executor.pause()
    cycles = 0
    while executor.state != "paused":
        executor.advance(1)
        cycles += 1
    assert cycles * executor.motion.dt <= 0.102
    assert not executor.gate
    where = executor.u
    executor.advance(500)
    assert executor.u == where
    executor.resume()
    run_to_end(executor)
    assert executor.state == "done"


def test_a_fault_stops_all_axes_with_the_dispenser_off_until_reset():
    executor = new_executor()
    executor.load(zigzag_job(2))
    executor.run()
    while not executor.gate:
        executor.advance(1)
    executor.motion.inject("x_axis: following error")
    executor.advance(1)
    assert executor.state == "fault"
    assert not executor.gate
    executor.advance(200)
    here = executor.positions.copy()
    executor.advance(200)
    assert (executor.positions == here).all()
    with pytest.raises(Faulted, match="following error"):
        executor.enable()
    executor.reset_fault()
    executor.enable()
    assert executor.state == "idle"


def test_a_job_beyond_the_limits_is_refused():
    job = zigzag_job(1)
    positions = job.positions.copy()
    positions[7, 2] = -0.5
    bad = PrintJob(
        job.joint_names,
        job.times,
        positions,
        job.velocities,
        job.extrude,
        job.path_id,
        job.path_layer,
    )
    with pytest.raises(InvalidInput, match=r"z_axis to -0.5 .. -0.05; limits -0.16"):
        new_executor().check_job(bad)


def test_a_path_faster_than_the_limits_faults_before_the_wire():
    job = zigzag_job(1)
    quick = PrintJob(
        job.joint_names,
        job.times / 200,
        job.positions,
        job.velocities * 200,
        job.extrude,
        job.path_id,
        job.path_layer,
    )
    executor = new_executor()
    with pytest.raises(InvalidInput, match=r"limit 0\.5"):
        executor.check_job(quick)
    executor.load(quick)  # and if it had slipped through, it would end here
    executor.run()
    run_to_end(executor)
    assert executor.state == "fault"
    assert "limit 0.5" in executor.detail


def test_a_second_job_is_refused_while_one_runs():
    executor = new_executor()
    executor.load(zigzag_job(2))
    executor.run()
    executor.advance(600)
    with pytest.raises(Busy):
        executor.load(zigzag_job(1))


def test_resume_refuses_another_job_and_another_homing():
    executor = new_executor()
    executor.load(zigzag_job(2))
    executor.run()
    executor.advance(1000)
    executor.stop()
    run_to_end(executor)
    checkpoint = executor.checkpoint()
    checkpoint.check_resumable(zigzag_job(2).digest(), executor.motion.homing_epoch)
    with pytest.raises(Refused, match="not"):
        checkpoint.check_resumable(zigzag_job(3).digest(), executor.motion.homing_epoch)
    executor.motion.home()
    with pytest.raises(Refused, match="homed"):
        checkpoint.check_resumable(zigzag_job(2).digest(), executor.motion.homing_epoch)


def test_simulated_axes_follow_closely_and_deterministically():
    def trace() -> np.ndarray:
        executor = new_executor()
        executor.load(zigzag_job(1))
        executor.run()
        rows = []
        while executor.state == "printing":
            executor.advance(7)
            rows.append(np.r_[executor.positions, executor.targets])
        return np.array(rows)

    one, two = trace(), trace()
    assert (one == two).all()
    error = np.abs(one[:, :3] - one[:, 5:8]).max()
    assert 0 < error < 1e-4  # a lag of tens of micrometres, not none


@given(
    st.lists(
        st.tuples(st.floats(0.05, 2.0), st.sampled_from(["stop", "fault", "pause"])), max_size=6
    )
)
@settings(deadline=None, derandomize=True, max_examples=8)
def test_no_bead_is_printed_twice_or_left_out(interruptions):
    """Whatever interrupts a print, what is deposited over all runs is each span once."""
    job = zigzag_job(2, seconds=1.0)
    wanted = job.intervals()
    executor, start, log = new_executor(), 0.0, []
    for delay, kind in [*interruptions, (1e9, "end")]:
        executor.load(job, start_u=start, overlap_s=0.2)
        executor.run()
        begin = executor.cycles
        while executor.state == "printing" and (
            executor.u < 0 or (executor.cycles - begin) * executor.motion.dt < delay
        ):
            executor.advance(1)
            log.append((executor.u, executor.gate, executor.rate))
        if kind == "fault":
            executor.motion.inject("injected")
        elif kind == "stop":
            executor.stop()
        elif kind == "pause" and executor.state == "printing":
            executor.pause()
            while executor.state == "pausing":
                executor.advance(1)
                log.append((executor.u, executor.gate, executor.rate))
            executor.stop()
        for _ in range(120):
            executor.advance(1)
            log.append((executor.u, executor.gate, executor.rate))
        start = executor.done_u
        if executor.state == "done":
            break
        executor.reset_fault()
        executor.enable()
        if executor.state == "stopped":
            executor.state = "idle"
    dt = executor.motion.dt
    pieces = np.array(sorted((u - rate * dt, u) for u, gate, rate in log if gate))
    gaps = pieces[1:, 0] - pieces[:-1, 1]
    assert gaps.min() >= -dt - 1e-9  # nothing twice, but for one cycle where a run took over
    for low, high in wanted:
        within = pieces[(pieces[:, 1] > low - 1e-9) & (pieces[:, 0] < high + 1e-9)]
        edges = np.r_[low, within.ravel(), high]
        assert (edges[2::2] - edges[1:-1:2]).max() < 3 * dt  # nothing left out
    outside = (pieces[:, 1:] < wanted[:, 0] - dt) | (pieces[:, 1:] > wanted[:, 1] + dt)
    assert not outside.all(axis=1).any()
