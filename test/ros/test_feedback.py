# SPDX-License-Identifier: Apache-2.0
"""Feedback over the real middleware: nothing is lost to a busy client or a late one."""

from __future__ import annotations

import threading
import time

import pytest
from rclpy.action import ActionClient, ActionServer
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from ros_processes import Background

from vega_msgs.action import PlanLayers
from vega_planner.nodes.feedback import EVERY_STAGE, await_listener
from vega_planner.nodes.session import Session

STAGES = [f"stage {index}" for index in range(100)]


@pytest.fixture
def server(ros):
    """A node that can serve the action in a namespace of its own."""
    node = Node("planner", namespace="/feedback")
    executor = MultiThreadedExecutor(num_threads=2)
    executor.add_node(node)
    spinning = threading.Thread(target=executor.spin, daemon=True)
    spinning.start()
    yield node
    executor.shutdown()
    spinning.join()
    node.destroy_node()


def test_a_client_that_is_busy_for_a_while_hears_of_every_stage(server):
    published, all_heard = threading.Event(), threading.Event()
    heard = []

    def execute(goal):
        await_listener(server, "plan_layers")
        for stage in STAGES:
            goal.publish_feedback(PlanLayers.Feedback(stage=stage))
        published.set()
        all_heard.wait(30)
        goal.succeed()
        return PlanLayers.Result()

    def listen(progress):
        assert published.wait(30)
        heard.append(progress.stage)
        if len(heard) == len(STAGES):
            all_heard.set()

    action = ActionServer(
        server, PlanLayers, "plan_layers", execute, feedback_pub_qos_profile=EVERY_STAGE
    )
    client = Session(namespace="/feedback", name="busy_client")
    try:
        client.plan(PlanLayers.Goal(mesh="part.stl"), listen)
    finally:
        client.close()
        action.destroy()
    assert heard == STAGES


def test_a_listener_that_comes_late_is_waited_for(server):
    waiting = Background(lambda: await_listener(server, "plan_layers"))
    time.sleep(0.2)
    other = Node("late_client", namespace="/feedback")
    client = ActionClient(other, PlanLayers, "plan_layers")
    waiting.result()
    assert server.count_subscribers("plan_layers/_action/feedback") == 1
    client.destroy()
    other.destroy_node()


def test_who_never_listens_is_not_waited_for_long(server):
    Background(lambda: await_listener(server, "nobody_asks")).result(20.0)
    assert server.count_subscribers("nobody_asks/_action/feedback") == 0
