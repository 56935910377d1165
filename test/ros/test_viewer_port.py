# SPDX-License-Identifier: Apache-2.0
"""The viewer's buttons act on the real nodes."""

import time

import pytest

from vega_planner.errors import Cancelled, DriverError, InvalidInput
from vega_planner.settings import Settings
from vega_planner.viewer.job import MachineChoice


@pytest.fixture
def job(ros):
    from vega_planner.nodes.viewer_port import RosJob

    port = RosJob()
    yield port
    port.close()


@pytest.fixture
def box(tmp_path):
    import trimesh

    path = tmp_path / "box.stl"
    trimesh.creation.box((12.0, 10.0, 6.0)).subdivide().subdivide().export(path)
    return path


def until(claim, seconds=60.0):
    end = time.monotonic() + seconds
    while not claim():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.02)


def test_a_plan_is_made_printed_paused_resumed_and_stopped(job, box, tmp_path):
    """The clock of the path stands while paused, and the dispenser is off then."""
    settings = Settings().updated({"part": {"brr": ("down",)}})
    said = []
    folder = job.plan(box, settings, tmp_path / "plan", said.append)
    assert (folder / "trajectory.csv").is_file()
    assert {"layers", "toolpaths", "trajectory"} <= {progress.stage for progress in said}
    job.print(folder, MachineChoice(pace=5.0))
    until(lambda: job.progress().state == "printing" and job.progress().dispensing)
    assert set(job.progress().joints) == {"x_axis", "y_axis", "z_axis", "a_axis", "b_axis"}
    job.pause()
    until(lambda: job.progress().state == "paused")
    held = job.progress()
    assert not held.dispensing
    assert 0 < held.progress < 1
    time.sleep(0.3)
    assert job.progress().path_time_s == held.path_time_s
    job.resume()
    until(lambda: job.progress().path_time_s > held.path_time_s)
    job.stop()
    until(lambda: job.progress().state == "stopped")
    assert not job.progress().dispensing


def test_a_plan_that_is_stopped_leaves_nothing(job, tmp_path):
    """Of layers so thin that planning takes many seconds: the stop comes long before its end."""
    import trimesh

    block = tmp_path / "block.stl"
    trimesh.creation.box((30.0, 30.0, 30.0)).export(block)
    thin = {"layers": {"thickness_mm": 0.2}, "toolpaths": {"width_mm": 0.3}}

    def stop(progress):
        if progress.stage != "starting the planner":
            raise Cancelled("enough")

    with pytest.raises(Cancelled):
        job.plan(block, Settings().updated(thin), tmp_path / "plan", stop)
    assert not (tmp_path / "plan").exists()


def test_buttons_without_a_print_are_refused(job):
    for action in (job.pause, job.resume, job.stop):
        with pytest.raises(DriverError, match="nothing is printing"):
            action()


def test_a_folder_without_a_plan_is_refused(job, tmp_path):
    with pytest.raises(InvalidInput, match=r"summary\.json"):
        job.print(tmp_path, MachineChoice())
