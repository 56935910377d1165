# SPDX-License-Identifier: Apache-2.0
"""Action `follow_joint_trajectory`, with stand-ins for what only a full ROS 2 has."""

from __future__ import annotations

import sys
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Duration, Time
from std_msgs.msg import Header
from synthetic import JOINTS
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from vega_planner.errors import Busy, Cancelled, Faulted
from vega_robot_driver.nodes import follow_joint_trajectory


class Action:
    """Stands for control_msgs/action/FollowJointTrajectory, with its published numbers."""

    class Result(SimpleNamespace):
        SUCCESSFUL, INVALID_GOAL, PATH_TOLERANCE_VIOLATED = 0, -1, -4

        def __init__(self) -> None:
            super().__init__(error_code=0, error_string="")

    class Feedback(SimpleNamespace):
        def __init__(self, joint_names: list[str]) -> None:
            super().__init__(header=Header(), joint_names=joint_names)


class Goal:
    """A goal, and what becomes of it."""

    def __init__(self, trajectory: JointTrajectory, cancelled: bool = False) -> None:
        self.request = SimpleNamespace(trajectory=trajectory)
        self.is_cancel_requested = cancelled
        self.ended, self.feedback = "", []

    def succeed(self) -> None:
        self.ended = "succeeded"

    def abort(self) -> None:
        self.ended = "aborted"

    def canceled(self) -> None:
        self.ended = "canceled"

    def publish_feedback(self, feedback: Any) -> None:
        self.feedback.append(feedback)


def trajectory(names: tuple[str, ...] = JOINTS) -> JointTrajectory:
    points = [
        JointTrajectoryPoint(positions=[0.01 * k] * 5, time_from_start=Duration(sec=k, nanosec=0))
        for k in range(3)
    ]
    return JointTrajectory(joint_names=list(names), points=points)


@pytest.fixture
def offered(monkeypatch):
    """The action with a given way to run jobs; returns what executes a goal."""
    module, actions = ModuleType("control_msgs"), ModuleType("control_msgs.action")
    actions.FollowJointTrajectory = Action
    monkeypatch.setitem(sys.modules, "control_msgs", module)
    monkeypatch.setitem(sys.modules, "control_msgs.action", actions)

    def server(node, kind, name, execute, **options):
        assert (kind, name) == (Action, "follow_joint_trajectory")
        return execute

    monkeypatch.setattr(follow_joint_trajectory, "ActionServer", server)
    clock = SimpleNamespace(now=lambda: SimpleNamespace(to_msg=Time))
    node = SimpleNamespace(get_clock=lambda: clock)
    return lambda run: follow_joint_trajectory.offer(node, None, lambda: JOINTS, run)


def test_without_control_msgs_there_is_no_action(monkeypatch):
    monkeypatch.setitem(sys.modules, "control_msgs", None)
    assert follow_joint_trajectory.offer(None, None, tuple, lambda *_: None) is None


def test_motion_in_any_order_of_joints_is_run_and_shown(offered):
    jobs = []

    def run(job, show, cancelled):
        jobs.append(job)
        assert not cancelled()
        show(SimpleNamespace(targets=np.full(5, 0.02), positions=np.full(5, 0.01), u=1.5))

    goal = Goal(trajectory(JOINTS[::-1]))
    assert offered(run)(goal).error_code == 0
    assert goal.ended == "succeeded"
    assert jobs[0].joint_names == JOINTS and not jobs[0].extrude.any()
    assert list(goal.feedback[0].error.positions) == pytest.approx([0.01] * 5)
    assert goal.feedback[0].actual.time_from_start == Duration(sec=1, nanosec=500_000_000)


@pytest.mark.parametrize(
    ("error", "cancelled", "ended", "code"),
    [
        (Cancelled("stopped"), True, "canceled", 0),
        (Cancelled("stopped by a service"), False, "aborted", 0),
        (Faulted("x_axis fault"), False, "aborted", -4),
        (Busy("another job"), False, "aborted", -1),
    ],
)
def test_what_ends_motion_is_told(offered, error, cancelled, ended, code):
    def run(job, show, cancelled):
        raise error

    goal = Goal(trajectory(), cancelled)
    result = offered(run)(goal)
    assert (goal.ended, result.error_code) == (ended, code)
    assert str(error) in result.error_string


def test_other_joints_are_an_invalid_goal(offered):
    goal = Goal(trajectory(("a", "b", "c", "d", "e")))
    result = offered(lambda *_: None)(goal)
    assert (goal.ended, result.error_code) == ("aborted", -1)
    assert "the robot has x_axis" in result.error_string
