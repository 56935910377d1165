# SPDX-License-Identifier: Apache-2.0
"""The schedule of cycles, and how it stays with the drives' clocks; the clocks are the test's."""

from __future__ import annotations

import gc
import socket
import sys
import time
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from synthetic import machine

from vega_robot_driver.machine import Machine
from vega_robot_driver.motion.bus_config import BusConfig, read_bus_config
from vega_robot_driver.motion.drive_bus import DriveBus
from vega_robot_driver.motion.ethercat import EthercatMotion
from vega_robot_driver.process import RealTimeLoop
from vega_robot_driver.schedule import MOST_OVERRUNS, Schedule

BUS = Path(__file__).parents[2] / "config" / "machines" / "emulated.yaml"
PERIOD = 0.002


class Clock:
    """A clock that only sleeping and working move on."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def schedule(clock):
    return Schedule(PERIOD, clock=clock, sleep=clock.sleep)


def test_work_within_the_period_does_not_shift_the_schedule(clock, schedule):
    chance = np.random.default_rng(0)
    for _ in range(1000):
        schedule.wait()
        clock.now += chance.uniform(0.0, 0.9 * PERIOD)
    schedule.wait()
    assert clock.now == pytest.approx(100.0 + 1001 * PERIOD)
    assert schedule.overruns == 0
    assert schedule.lateness[2] < 1e-9


def test_missed_cycles_are_counted_and_not_made_up_for(clock, schedule):
    schedule.wait()
    clock.now += 10.5 * PERIOD
    schedule.wait()
    late = clock.now
    assert schedule.overruns == 1
    schedule.wait()
    assert clock.now == pytest.approx(late + PERIOD)
    assert schedule.overruns == 1


def test_overruns_stop_the_machine_only_in_a_row(clock, schedule):
    for _ in range(3):
        for _ in range(MOST_OVERRUNS - 1):
            clock.now += 3 * PERIOD
            schedule.wait()
        assert not schedule.overrun
        schedule.wait()
    for _ in range(MOST_OVERRUNS):
        clock.now += 3 * PERIOD
        schedule.wait()
    assert schedule.overrun


def test_lateness_tells_median_percentile_and_worst(clock, schedule):
    late = np.arange(1, 201) * 1e-6
    for seconds in np.random.default_rng(1).permutation(late):
        clock.now += PERIOD + seconds
        schedule.wait()
        clock.now -= seconds
    assert np.allclose(schedule.lateness, [late[99], late[197], late[199]], atol=1e-9)


class DriftingBus(DriveBus):
    """Drives whose clock runs faster than the computer's by some parts in a million."""

    def __init__(self, config: BusConfig, clock: Clock, drift: float) -> None:
        super().__init__(config, "", dt=PERIOD)
        self._clock, self._drift, self.clocked = clock, drift, True

    @property
    def clock_offset(self) -> float:
        there = round(self._clock.now * (1 + self._drift) * 1e9) + 700_000
        cycle = round(PERIOD * 1e9)
        return (there % cycle - cycle // 2) * 1e-9


@pytest.mark.parametrize("drift", [-100e-6, 0.0, 100e-6])
def test_frames_stay_in_the_middle_of_the_drives_cycle(clock, schedule, drift):
    config = read_bus_config(BUS)
    bus = DriftingBus(config, clock, drift)
    motion = EthercatMotion(config, "", dt=PERIOD, bus=bus)
    offsets = []
    for _ in range(5000):
        schedule.wait(motion.clock_correction)
        offsets.append(bus.clock_offset)
    assert abs(offsets[0]) > 100e-6  # it does not begin there
    # 100 ppm of 2 ms are 0.2 µs a cycle; a fiftieth of the offset is taken back in each.
    assert np.abs(offsets[-2500:]).max() < 15e-6


def loop(folder: Path, told: Machine) -> RealTimeLoop:
    return RealTimeLoop(told, folder, socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))


@pytest.mark.parametrize(
    ("batched", "waits", "state"),
    [(False, False, "fault"), (False, True, "off"), (True, False, "off")],
)
def test_repeated_overruns_are_a_fault_where_the_axes_do_not_wait(tmp_path, batched, waits, state):
    """Real drives; emulated ones, which wait for a late cycle; and a simulation."""
    running = loop(tmp_path, machine())
    running._executor.motion.batched, running._executor.motion.waits = batched, waits
    for _ in range(MOST_OVERRUNS):
        assert running._executor.state == "off"
        running._schedule._wake -= 1.0
        running._schedule.wait()
        running._watch_schedule()
    assert running._executor.state == state


def test_a_bus_that_took_long_to_come_up_still_waits_for_its_client(tmp_path):
    """Time without a client is counted from the first cycle, not from the process's start."""
    running = loop(tmp_path, machine(orphan_s=0.2, record=False))
    running._executor.motion.open = lambda: time.sleep(0.3)
    cycles = []

    def advance(count):
        cycles.append(count)
        running._ended = running._ended or len(cycles) > 3

    running._executor.advance = advance
    interval = sys.getswitchinterval()
    try:
        running.run()
    finally:  # it takes the interpreter for its own
        sys.setswitchinterval(interval)
        gc.enable()
        gc.unfreeze()
    assert len(cycles) > 3
