# SPDX-License-Identifier: Apache-2.0
"""The driver in a process of its own: prints, pauses, cancels, refuses, and dies safely."""

from __future__ import annotations

import json
import threading
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from ros_processes import Background, until
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from synthetic import zigzag_job

from vega_msgs.action import ExecutePrint
from vega_msgs.msg import JointPath, PrintStatus
from vega_msgs.srv import Jog
from vega_planner.errors import Busy, Cancelled, CertificateMismatch, LinkTimeout, Refused
from vega_planner.nodes.conversions import flat
from vega_planner.progress import silent
from vega_robot_driver.status import StatusPage


def goal(passes: int = 4, **values: Any) -> ExecutePrint.Goal:
    job = zigzag_job(passes)
    path = JointPath(
        joint_names=list(job.joint_names),
        times=flat("d", job.times),
        positions=flat("d", job.positions),
        velocities=flat("d", job.velocities),
        extrude=job.extrude.tolist(),
        path_id=flat("i", job.path_id),
        path_layer=flat("i", job.path_layer),
    )
    certificate = json.dumps({"sha256": {"job": job.digest()}})
    return ExecutePrint.Goal(trajectory=path, certificate=certificate, **values)


class Watch:
    """The driver's topics as they come."""

    def __init__(self, session: Any) -> None:
        self._session = session
        self.status: list[PrintStatus] = []
        self.joints: list[JointState] = []
        self.diagnostics: list[DiagnosticArray] = []
        node = session.node
        self._subscriptions = [
            node.create_subscription(PrintStatus, "print_status", self.status.append, 10),
            node.create_subscription(JointState, "joint_states", self.joints.append, 10),
            node.create_subscription(DiagnosticArray, "diagnostics", self.diagnostics.append, 10),
        ]

    def until_state(self, state: str) -> PrintStatus:
        return until(lambda: next((s for s in self.status[-3:] if s.state == state), None))

    def close(self) -> None:
        for subscription in self._subscriptions:
            self._session.node.destroy_subscription(subscription)


@pytest.fixture
def watch(session):
    watching = Watch(session)
    yield watching
    watching.close()


def call(session: Any, name: str, kind: Any = Trigger, **values: Any) -> Any:
    client = session.node.create_client(kind, name)
    until(client.service_is_ready)
    answer = session._call(client, kind.Request(**values))
    session.node.destroy_client(client)
    return answer


def test_prints_a_job_and_streams_where_it_is(session, driver, watch):
    fractions = []
    result = session.execute(goal(), lambda progress: fractions.append(progress.fraction))
    assert (result.error_code, result.progress, result.paths_done) == (0, 1.0, 4)
    assert result.duration >= zigzag_job(4).duration_s
    assert 0 < result.max_tracking_error < 1e-4
    assert fractions == sorted(fractions) and len(fractions) > 5
    states = watch.status
    assert any(s.dispenser_on and s.pressure > 100e3 and s.path >= 0 for s in states)
    assert {s.layer for s in states} >= {0, 1}
    until(lambda: watch.status[-1].state == "done")
    assert not watch.status[-1].dispenser_on
    assert list(watch.joints[-1].name) == list(zigzag_job(1).joint_names)


def test_pause_resume_and_stop(session, driver, watch):
    running = Background(lambda: session.execute(goal(), silent))
    until(lambda: any(s.dispenser_on for s in watch.status))
    assert call(session, "pause").success
    paused = watch.until_state("paused")
    assert paused.speed_ratio == 0.0 and not paused.dispenser_on
    assert call(session, "resume").success
    until(lambda: watch.status[-1].path_time > paused.path_time + 0.5)
    assert call(session, "stop").success
    with pytest.raises(Cancelled, match="stopped on request"):
        running.result()
    assert not watch.until_state("stopped").dispenser_on
    refused = call(session, "pause")
    assert not refused.success and "nothing to pause" in refused.message


def test_a_print_is_cancelled_in_the_middle(session, driver, watch):
    running = Background(lambda: session.execute(goal(), silent))
    until(lambda: any(s.dispenser_on for s in watch.status))
    session.cancel()
    with pytest.raises(Cancelled):
        running.result()
    stopped = watch.until_state("stopped")
    assert not stopped.dispenser_on and stopped.speed_ratio == 0.0
    assert driver.running
    assert session.execute(goal(1), silent).error_code == 0


def test_a_second_job_is_refused_while_one_runs(session, driver):
    started = threading.Event()
    running = Background(lambda: session.execute(goal(), lambda progress: started.set()))
    assert started.wait(30)
    first = session._goal
    with pytest.raises(Busy):
        session.execute(goal(1), silent)
    session._goal = first
    assert running.result().error_code == 0


def test_a_job_without_its_certificate_is_refused(session, driver):
    forged = goal()
    forged.trajectory.times[3] += 1e-3
    with pytest.raises(CertificateMismatch):
        session.execute(forged, silent)


def test_an_inactive_driver_refuses(other, start_driver):
    start_driver()
    with pytest.raises(Refused, match="not active"):
        other.execute(goal(), silent)


def test_jogs_one_joint_within_its_limits(session, driver, watch):
    start = until(lambda: watch.joints)[-1].position[2]
    assert call(session, "robot_driver/jog", Jog, joint="z_axis", distance=-0.01).success
    until(lambda: abs(watch.joints[-1].position[2] - start + 0.01) < 1e-5)
    far = call(session, "robot_driver/jog", Jog, joint="z_axis", distance=5.0)
    assert not far.success and "limits" in far.message
    wrong = call(session, "robot_driver/jog", Jog, joint="w_axis", distance=0.1)
    assert not wrong.success and "has: x_axis" in wrong.message


def machine_reports(watch: Watch) -> list[str]:
    return [
        status.message
        for array in watch.diagnostics
        for status in array.status
        if status.name == "robot_driver: machine" and status.level != b"\0"
    ]


def test_a_killed_driver_leaves_the_dispenser_off_and_the_print_resumable(
    other, start_driver, tmp_path
):
    folder = tmp_path / "machine"
    first = start_driver()
    other.bring_up()
    running = Background(lambda: other.execute(goal(8), silent))
    page = StatusPage(folder)
    until(lambda: page.read().dispenser_on)
    first.kill()
    until(lambda: page.read().state == "stopped", 5.0)
    left = page.read()
    assert not left.dispenser_on and left.rate == 0.0 and left.idle_on_cycles == 0
    assert left.detail == "the client is gone"
    other.abandon()
    with pytest.raises(LinkTimeout, match="abandoned"):
        running.result()

    watch = Watch(other)
    start_driver()
    assert "the client is gone" in until(lambda: machine_reports(watch))[0]
    other.bring_up()
    result = other.execute(goal(8, resume=True), silent)
    assert (result.error_code, result.paths_done) == (0, 8)
    with pytest.raises(Refused, match="no interrupted print"):
        other.execute(goal(8, resume=True), silent)
    watch.close()
