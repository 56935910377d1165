# SPDX-License-Identifier: Apache-2.0
"""The EtherCAT axes on drives in the same process: identity, homing, torque, safety.

Time is the frames': the same frames give the same answers on any computer.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[2] / "bench"))
import driver_faults
from driver import accelerations
from interruptions import interrupted
from synthetic import JOINTS, LIMITS, zigzag_job

from vega_planner.errors import DriverError, Faulted, InvalidInput, Refused
from vega_robot_driver.control.calibration import calibration_job
from vega_robot_driver.dispenser.digital_output import DigitalOutputDispenser
from vega_robot_driver.executor import Executor
from vega_robot_driver.job import PrintJob
from vega_robot_driver.limits import Limits
from vega_robot_driver.motion.bus_config import BusConfig, read_bus_config
from vega_robot_driver.motion.direct_bus import DirectDrives, DirectMotion

ROOT = Path(__file__).parents[2]
BUS = ROOT / "config" / "machines" / "emulated.yaml"
HOST = ROOT / "config" / "machines" / "emulated_host.yaml"
DT = 0.002
Change = Callable[[dict[str, Any]], None]


def bus(folder: Path, change: Change, source: Path = BUS) -> BusConfig:
    """The configuration of a shipped machine file after a change, for the test's robot."""
    content = yaml.safe_load(source.read_text())
    change(content)
    path = folder / "bus.yaml"
    path.write_text(yaml.safe_dump(content))
    names = [row["joint"] for row in content["axes"]]
    at = [JOINTS.index(name) for name in names]
    limits = [[LIMITS[key][k] for k in at] for key in ("lower", "upper", "velocity")]
    return read_bus_config(path).for_joints(names, *limits)


def executor_on(config: BusConfig, drives: DirectDrives, folder: Path | None = None) -> Executor:
    motion = DirectMotion(config, drives, dt=DT, memory=folder)
    motion.open()
    told = [
        np.array([getattr(axis, name) for axis in config.axes])
        for name in ("lower", "upper", "velocity")
    ]
    executor = Executor(motion, DigitalOutputDispenser(), Limits(*told))
    executor.enable()
    return executor


def run(executor: Executor, job: PrintJob) -> None:
    executor.load(job)
    executor.run()
    while executor.state == "printing":
        executor.advance(1)


# -- identity -----------------------------------------------------------------------------


def test_swapped_cables_do_not_swap_axes(tmp_path):
    config = bus(tmp_path, lambda c: None)
    drives = DirectDrives(config, DT)
    drives.line.segment.slaves.reverse()
    executor = executor_on(config, drives)
    run(executor, zigzag_job(1, seconds=1.0))
    assert executor.state == "done"
    by_serial = {s.drive.identity[3]: s.drive for s in drives.line.segment.slaves}
    wanted = zigzag_job(1, seconds=1.0).positions[-1]
    for axis, position in zip(config.axes, wanted, strict=True):
        assert abs(by_serial[axis.serial].axis.position - position * axis.scale) < 3


@pytest.mark.parametrize(
    ("key", "value", "text"),
    [
        ("serial", 999, "no drive has y_axis's serial 102; found: .*999"),
        ("product", 0x777, r"the drive of y_axis \(serial 102\) is .* product 0x777"),
        ("vendor", 0x1234, r"the drive of y_axis \(serial 102\) is vendor 0x1234"),
    ],
)
def test_a_swapped_drive_is_not_moved(tmp_path, key, value, text):
    """A drive that is not the configured one keeps all drives without power and commands."""

    def swap(content: dict[str, Any]) -> None:
        content["axes"][1][key] = value

    drives = DirectDrives(bus(tmp_path, swap), DT)
    motion = DirectMotion(bus(tmp_path, lambda c: None), drives, dt=DT)
    with pytest.raises(DriverError, match=text):
        motion.open()
    for slave in drives.line.segment.slaves:
        assert slave.state == 1
        assert slave.drive.state.value == "switch on disabled"
        assert slave.drive.objects[0x6040] == 0


# -- homing -------------------------------------------------------------------------------


def with_homing(methods: dict[int, int]) -> Change:
    def change(content: dict[str, Any]) -> None:
        for place, method in methods.items():
            low, high = LIMITS["lower"][place] * 1e6, LIMITS["upper"][place] * 1e6
            switch = {17: low - 10, 18: high + 10, 37: 0}.get(method, 0)
            content["axes"][place]["homing"] = {
                "method": method,
                "speed": 40_000,
                "slow": 2_000,
                "acceleration": 1_000_000,
                "offset": round(switch),
            }

    return change


def home(executor: Executor) -> None:
    executor.home()
    for _ in range(20_000):
        executor.advance(1)
        if executor.state != "homing":
            return
    raise AssertionError("it homes for ever")


def test_axes_without_absolute_encoders_move_only_after_homing(tmp_path):
    config = bus(tmp_path, with_homing({0: 17, 2: 18}))
    drives = DirectDrives(config, DT)
    true = [slave.drive.axis for slave in drives.line.segment.slaves]
    true[0].position, true[0].origin = 51_234.0, -51_234
    true[2].position, true[2].origin = -30_000.0, 30_000
    executor = executor_on(config, drives, tmp_path)
    with pytest.raises(Refused, match="not homed"):
        executor.load(zigzag_job(1))
    epoch = executor.motion.homing_epoch
    home(executor)
    assert executor.state == "idle"
    assert executor.motion.homing_epoch == epoch + 1
    for k in (0, 2):
        assert abs(executor.positions[k] - true[k].position * 1e-6) < 2e-6
    run(executor, zigzag_job(1, seconds=1.0))
    assert executor.state == "done"
    assert abs(true[0].position - 20_000) < 3
    # A process that comes later finds drives that kept their reference, and the same epoch.
    executor.motion.abandon()
    drives.inject("silence 300")
    later = executor_on(config, drives, tmp_path)
    assert later.motion.homed
    assert later.motion.homing_epoch == epoch + 1


def test_a_homing_that_a_drive_refuses_is_a_fault(tmp_path):
    executor = executor_on(
        *(lambda c: (c, DirectDrives(c, DT)))(bus(tmp_path, with_homing({1: 3})))
    )
    home(executor)
    assert executor.state == "fault"
    assert "y_axis" in executor.detail
    assert not executor.motion.homed


def test_homing_needs_its_mode_in_the_mapping(tmp_path):
    def change(content: dict[str, Any]) -> None:
        with_homing({0: 17})(content)
        content["bus"]["rxpdo"].remove("6060:00:8")

    with pytest.raises(InvalidInput, match="x_axis is homed by its drive; rxpdo must map"):
        bus(tmp_path, change)


def test_a_misspelt_key_of_a_machine_file_is_named(tmp_path):
    def change(content: dict[str, Any]) -> None:
        content["dispenser"]["prot"] = "/dev/ttyS0"

    with pytest.raises(InvalidInput, match=r"dispenser has no 'prot'; choices: .*port"):
        bus(tmp_path, change)


# -- torque -------------------------------------------------------------------------------


def sweep(here: float, way: float, rounds: int) -> PrintJob:
    """One axis to and fro at 5 mm/s."""
    times, rows, rates = [0.0], [here], [0.0]
    for sign in (1.0, -1.0) * rounds:
        for duration, step, rate in (
            (0.3, 0.0, 0.0), (0.1, 0.25e-3, 5e-3), (way / 5e-3 - 0.1, way - 0.5e-3, 5e-3),
            (0.1, 0.25e-3, 0.0),
        ):  # fmt: skip
            times.append(times[-1] + duration)
            rows.append(rows[-1] + sign * step)
            rates.append(sign * rate)
    count = len(times)
    return PrintJob(
        ("z_axis",),
        np.array(times),
        np.array(rows)[:, None],
        np.array(rates)[:, None],
        np.zeros(count, np.bool_),
        np.full(count, -1),
        np.zeros(0, np.int64),
    )


def test_a_recorded_disturbance_makes_the_same_pid_track_within_micrometres(tmp_path):
    def only_z(content: dict[str, Any]) -> None:
        content["axes"] = [content["axes"][2]]
        content["dispenser"] = {}

    config = bus(tmp_path, only_z, HOST)
    drives = DirectDrives(config, DT)
    drives.line.segment.slaves[0].drive.axis.position = -60_000.0
    executor = executor_on(config, drives, tmp_path)
    executor.advance(500)

    def tracked() -> tuple[float, float]:
        job = sweep(float(executor.positions[0]), 8e-3, 4)
        executor.load(job)
        executor.run()
        rows = []
        while executor.state == "printing":
            executor.advance(1)
            rows.append((executor.u, executor.targets[0], executor.positions[0]))
        assert executor.state == "done", executor.detail
        u, target, found = np.array(rows).T
        u, target, error = u[:-1], target[:-1], found[1:] - target[:-1]
        period = job.duration_s / 4  # the first round warms up
        steady = (np.abs(np.gradient(target, DT)) > 4.95e-3) & (u > period)
        phase = np.round((u % period) / DT).astype(int)
        spread = [
            2 * error[steady & (phase == k)].std(ddof=1)
            for k in np.unique(phase[steady])[::20]
            if (steady & (phase == k)).sum() == 3
        ]
        return float(np.abs(error[steady]).mean()), float(np.mean(spread))

    plain, _ = tracked()
    here = executor.positions.copy()
    executor.motion.start_recording()
    run(
        executor,
        calibration_job(("z_axis",), here, here - 2e-3, here + 10e-3, np.array([5e-3])),
    )
    executor.motion.finish_recording(keep=True)
    mean, repeated = tracked()
    assert mean < 9.4e-6
    assert repeated < 2e-6
    assert mean < plain / 10
    # What was recorded is kept for the same homing, and a new process finds it.
    executor.motion.abandon()
    drives.inject("silence 300")
    later = DirectMotion(config, drives, dt=DT, memory=tmp_path)
    later.open()
    assert later._host is not None and later._host.disturbance is not None


def test_an_axis_that_the_computer_cannot_hold_is_a_fault(tmp_path):
    executor = executor_on(*(lambda c: (c, DirectDrives(c, DT)))(bus(tmp_path, no_change, HOST)))
    executor.load(zigzag_job(1))
    executor.run()
    executor.advance(100)
    executor.motion.inject("jam 1")
    executor.motion._host._window[:] = 1e-5
    executor.advance(2000)
    assert executor.state == "fault"
    assert "following error" in executor.detail
    with pytest.raises(Faulted):
        executor.enable()


def no_change(content: dict[str, Any]) -> None:
    """Leave the file as it is."""


def test_host_control_without_its_values_says_what_is_missing(tmp_path):
    def change(content: dict[str, Any]) -> None:
        content["bus"]["control"] = "host"

    with pytest.raises(InvalidInput, match="axis x_axis lacks 'host'"):
        bus(tmp_path, change)


def test_a_calibration_needs_the_loops_in_the_computer(tmp_path):
    executor = executor_on(*(lambda c: (c, DirectDrives(c, DT)))(bus(tmp_path, no_change)))
    with pytest.raises(InvalidInput, match="needs control 'host'"):
        executor.motion.start_recording()


# -- safety -------------------------------------------------------------------------------


@pytest.mark.parametrize("fault", sorted(driver_faults.INJECTED))
def test_no_fault_leaves_the_valve_open_at_standstill(fault):
    row = driver_faults.injected([fault])[fault]
    assert row["safe"], row
    assert row["on_at_standstill"] == 0
    assert row["valve_closed_ms"] <= 20
    assert row["standstill_ms"] <= 20


def test_drives_with_clocks_stop_by_themselves_when_their_master_freezes():
    row = driver_faults.injected(["frozen master (300 ms)"])["frozen master (300 ms)"]
    assert row["valve_closed_ms"] < 10  # long before their watchdog's 50 ms


def test_setpoints_stay_within_the_acceleration_limits():
    assert max(accelerations(24)["of_limit"]) <= 1.0


def test_a_hundred_interruptions_lose_and_double_no_bead():
    result = interrupted(100, seed=7)
    assert result["interruptions"] == 100
    assert min(result["by_kind"].values()) >= 5
    assert (result["beads_lost"], result["beads_doubled"]) == (0, 0)
