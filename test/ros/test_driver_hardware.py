# SPDX-License-Identifier: Apache-2.0
"""The driver on emulated drives: what its transitions mean, what it tells, replayed motion."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from builtin_interfaces.msg import Duration
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from ros_processes import Process, until
from synthetic import JOINTS
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from vega_msgs.action import ExecutePrint
from vega_planner.errors import Refused
from vega_planner.progress import silent
from vega_robot_driver.status import StatusPage


class Told:
    """The latest diagnostics, by the last word of their name."""

    def __init__(self, session: Any) -> None:
        self._latest: dict[str, Any] = {}
        self._node = session.node
        self._subscription = self._node.create_subscription(
            DiagnosticArray, "diagnostics", self._take, 10
        )

    def _take(self, message: DiagnosticArray) -> None:
        self._latest = {status.name.split(": ")[1]: status for status in message.status}

    def message(self, name: str) -> str:
        return self._latest[name].message if name in self._latest else ""

    def values(self, name: str) -> dict[str, str]:
        return {item.key: item.value for item in self._latest[name].values}

    def axes(self) -> set[str]:
        return {self.message(joint) for joint in JOINTS}

    def close(self) -> None:
        self._node.destroy_subscription(self._subscription)


@pytest.fixture
def told(other):
    told = Told(other)
    yield told
    told.close()


@pytest.fixture
def start(start_driver, told):
    """Start a driver on emulated drives and wait until it speaks.

    Services of one that another test killed seem to be there for a while.
    """

    def begin(**parameters: Any) -> Process:
        process = start_driver(hardware="emulated", time_scale=20.0, **parameters)
        until(lambda: told.message("machine"))
        return process

    return begin


def change(session: Any, transition: int) -> bool:
    until(session._change.service_is_ready)
    request = ChangeState.Request(transition=Transition(id=transition))
    return session._call(session._change, request, 30.0).success


def motion(*rows: tuple[float, ...]) -> JointTrajectory:
    points = [
        JointTrajectoryPoint(positions=list(row), time_from_start=Duration(sec=1 + k, nanosec=0))
        for k, row in enumerate(rows)
    ]
    return JointTrajectory(joint_names=list(JOINTS), points=points)


def test_transitions_bring_the_bus_up_power_the_axes_and_take_both_away(
    other, start, told, tmp_path
):
    start()
    assert change(other, Transition.TRANSITION_CONFIGURE)
    pid = StatusPage(tmp_path / "machine").read().pid
    until(lambda: told.axes() == {"switch on disabled"})
    assert told.message("machine") == "off"

    assert change(other, Transition.TRANSITION_ACTIVATE)
    until(lambda: told.axes() == {"operation enabled"})
    until(lambda: told.message("machine") == "idle")
    machine, axis = told.values("machine"), told.values("z_axis")
    assert int(machine["cycles"]) > 0 and machine["wrong_working_counters"] == "0"
    for key in ("lateness_us_p50", "lateness_us_p99", "lateness_us_max", "overruns"):
        assert int(machine[key]) >= 0
    assert machine["clocks"] == "distributed"
    assert axis["error_code"] == "0x0000" and abs(float(axis["following_error"])) < 1e-5
    assert told.message("dispenser") == "off"
    assert told.values("dispenser")["cycles_on_at_standstill"] == "0"

    assert change(other, Transition.TRANSITION_DEACTIVATE)
    until(lambda: told.axes() == {"switch on disabled"})
    with pytest.raises(Refused, match="not active"):
        other.execute(ExecutePrint.Goal(joint_trajectory=motion((0.0,) * 5, (0.01,) * 5)), silent)

    assert change(other, Transition.TRANSITION_CLEANUP)
    until(lambda: not Path(f"/proc/{pid}").exists())


def test_a_joint_trajectory_is_replayed_on_the_drives_without_deposition(other, start, tmp_path):
    start()
    other.bring_up()
    rows = ((0.0,) * 5, (0.01, 0.005, -0.02, 0.1, 0.0), (0.02, 0.0, -0.03, 0.0, 0.1))
    result = other.execute(ExecutePrint.Goal(joint_trajectory=motion(*rows)), silent)
    assert (result.error_code, result.paths_done) == (0, 0)
    status = StatusPage(tmp_path / "machine").read()
    assert status.state == "done"
    assert abs(status.positions - rows[-1]).max() < 1e-5


def test_a_machine_file_that_lacks_something_fails_the_transition(other, start, tmp_path):
    """The log says what; the node goes on."""
    (tmp_path / "bus.yaml").write_text("bus: {}\naxes: []\n")
    process = start(machine=str(tmp_path / "bus.yaml"))
    assert not change(other, Transition.TRANSITION_CONFIGURE)
    assert process.running
    until(lambda: "bus lacks 'interface'" in process.log.read_text())
