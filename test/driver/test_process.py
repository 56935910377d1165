# SPDX-License-Identifier: Apache-2.0
"""The real-time process: a dead client leaves the axes held and the dispenser off."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from synthetic import machine, zigzag_job

from vega_planner.errors import Busy, LinkTimeout, Refused, VegaError
from vega_robot_driver.checkpoint import read_checkpoint
from vega_robot_driver.job import PrintJob
from vega_robot_driver.link import MachineLink
from vega_robot_driver.status import StatusPage


def until(condition: Callable[[], bool], seconds: float = 20.0) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "it never came to be"
        time.sleep(0.002)


def send(link: MachineLink, job: PrintJob, **options: float) -> None:
    arrays = {name: getattr(job, name) for name in job.__dataclass_fields__}
    way = np.zeros((0, len(job.joint_names)))
    np.savez(link.folder / "job.npz", waypoints=way, **arrays)
    link.ask("load", job="job.npz", **options)


@pytest.fixture
def link(tmp_path):
    link = MachineLink(tmp_path, machine(time_scale=20.0))
    yield link
    link.close()


def test_prints_to_the_end_faster_than_real_time(link):
    job = zigzag_job(3)
    link.ask("enable")
    send(link, job)
    link.ask("run")
    until(lambda: link.status().state == "done")
    status = link.status()
    assert status.paths_done == 3
    assert status.job == job.digest()
    assert status.idle_on_cycles == 0
    assert not status.dispenser_on


def test_requests_in_the_wrong_state_are_refused_by_class(link):
    with pytest.raises(Refused):
        link.ask("run")
    with pytest.raises(Refused):
        link.ask("pause")
    link.ask("enable")
    send(link, zigzag_job(3))
    link.ask("run")
    with pytest.raises(Busy):
        send(link, zigzag_job(3))


CLIENT = """
import sys, time, numpy as np
sys.path.insert(0, {here!r})
from pathlib import Path
from synthetic import machine, zigzag_job
from test_process import send
from vega_robot_driver.link import MachineLink
link = MachineLink(Path({folder!r}), machine(time_scale=2.0))
link.ask("enable")
send(link, zigzag_job(3))
link.ask("run")
print("ready", flush=True)
time.sleep(60)
"""


@pytest.mark.parametrize("way", [signal.SIGKILL, signal.SIGSTOP])
def test_a_dead_or_frozen_client_leaves_the_dispenser_off_and_the_axes_held(tmp_path, way):
    here = str(Path(__file__).parent)
    client = subprocess.Popen(
        [sys.executable, "-c", CLIENT.format(here=here, folder=str(tmp_path))],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert client.stdout is not None
        assert client.stdout.readline() == "ready\n"
        page = StatusPage(tmp_path)
        until(lambda: page.read().dispenser_on)
        os.kill(client.pid, way)
        until(lambda: page.read().state == "stopped")
        status = page.read()
        assert not status.dispenser_on
        assert status.rate == 0.0
        assert status.idle_on_cycles == 0
        assert "client" in status.detail
        held = page.read().targets
        until(lambda: page.read().cycles > status.cycles + 200)
        assert (page.read().targets == held).all()
        until(
            lambda: (
                getattr(read_checkpoint(tmp_path / "checkpoint.json"), "state", "") == "stopped"
            )
        )
        checkpoint = read_checkpoint(tmp_path / "checkpoint.json")
        assert checkpoint is not None and checkpoint.unfinished
        assert checkpoint.job == zigzag_job(3).digest()
    finally:
        client.kill()
        client.wait()
    again = MachineLink(tmp_path, machine(time_scale=200.0))
    assert again.joined
    send(again, zigzag_job(3), start_u=checkpoint.done, overlap_s=0.2)
    again.ask("override", ratio=1.0)
    again.ask("run")
    again.close()


def test_a_machine_that_cannot_start_says_why(tmp_path):
    with pytest.raises(VegaError, match="ethercat"):
        MachineLink(tmp_path, machine(hardware="ethercat"))


def test_no_machine_is_said_so(tmp_path):
    with pytest.raises(LinkTimeout, match="no machine runs"):
        MachineLink(tmp_path, None)
