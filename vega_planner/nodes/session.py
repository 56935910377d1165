# SPDX-License-Identifier: Apache-2.0
"""A client of both nodes: bring the driver up, plan, print. Used by the command line."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any
from uuid import uuid4

import rclpy
from action_msgs.msg import GoalStatus
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.action import ActionClient
from rclpy.action.client import ClientGoalHandle
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future
from unique_identifier_msgs.msg import UUID

from vega_msgs.action import ExecutePrint, PlanLayers
from vega_planner.errors import DriverError, LinkTimeout, VegaError, error_class
from vega_planner.nodes.feedback import EVERY_STAGE
from vega_planner.progress import Progress, Report

#: Time the nodes may take to appear [s].
STARTUP = 30.0
#: Time a node may take to answer a request [s].
ANSWER = 20.0
#: Times something is sent before a silent node is given up.
SENDINGS = 4

_ACTIVE = State.PRIMARY_STATE_ACTIVE


@dataclass
class SendGoalAnswer:
    """Stands for the answer to a goal that was lost on the way back."""

    accepted: bool


class Session:
    """Talks to the nodes `planner` and `robot_driver` of a namespace.

    Args:
        namespace: Namespace of the nodes, "" for the root.
        name: Name of the client's own node.
        alive: Called while waiting; raises where a node has died.
    """

    def __init__(
        self, namespace: str = "", name: str = "print_job", alive: Callable[[], None] | None = None
    ) -> None:
        self.node = Node(name, namespace=namespace)
        self._alive = alive or (lambda: None)
        self._plan = ActionClient(
            self.node, PlanLayers, "plan_layers", feedback_sub_qos_profile=EVERY_STAGE
        )
        self._print = ActionClient(self.node, ExecutePrint, "execute_print")
        self._state = self.node.create_client(GetState, "robot_driver/get_state")
        self._change = self.node.create_client(ChangeState, "robot_driver/change_state")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self._goal: Any = None
        self._closing = threading.Event()
        self._abandoned = threading.Event()
        self._thread = threading.Thread(target=self._spin, name="session", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Leave."""
        self._closing.set()
        self._thread.join()  # a thread that still spins at exit would abort the process
        self._executor.shutdown()
        self._plan.destroy()
        self._print.destroy()
        self.node.destroy_node()

    def _spin(self) -> None:
        while not self._closing.is_set() and rclpy.ok():
            try:
                self._executor.spin_once(timeout_sec=0.1)
            except ExternalShutdownException:
                return

    def bring_up(self) -> None:
        """Configure and activate the driver, as far as it is not.

        Raises:
            DriverError: If it does not come up.
        """
        self._until(self._state.service_is_ready, "node robot_driver")
        for transition, reached in (
            (Transition.TRANSITION_CONFIGURE, {State.PRIMARY_STATE_INACTIVE, _ACTIVE}),
            (Transition.TRANSITION_ACTIVATE, {_ACTIVE}),
        ):
            request = ChangeState.Request(transition=Transition(id=transition))
            for _ in range(SENDINGS):
                if self._driver_state() in reached:
                    break
                try:
                    changed = self._call(self._change, request, STARTUP).success
                except LinkTimeout:
                    continue  # perhaps only the answer is lost: the state tells
                if not changed:
                    raise DriverError("the driver does not come up; see its log")
            else:
                raise LinkTimeout(f"the driver did not answer {SENDINGS} requests to come up")

    def wait_until_active(self) -> None:
        """Wait until somebody else has activated the driver.

        Raises:
            LinkTimeout: If nobody does.
        """
        self._until(self._state.service_is_ready, "node robot_driver")
        self._until(lambda: self._driver_state() == _ACTIVE, "an active robot_driver")

    def plan(self, goal: PlanLayers.Goal, report: Report) -> PlanLayers.Result:
        """Plan.

        Raises:
            VegaError: What the planner raised, by its class.
        """

        def tell(message: Any) -> None:
            given = message.feedback
            report(Progress(given.stage, given.progress, given.layers, given.detail))

        self._until(self._plan.server_is_ready, "action plan_layers")
        return self._run(self._plan, goal, tell)

    def execute(self, goal: ExecutePrint.Goal, report: Report) -> ExecutePrint.Result:
        """Print.

        Raises:
            VegaError: What the driver raised, by its class.
        """

        def tell(message: Any) -> None:
            given = message.feedback
            left = f"{given.state}, layer {given.layer}, {given.time_left:.0f} s left"
            report(Progress("printing", given.progress, detail=left))

        self._until(self._print.server_is_ready, "action execute_print")
        return self._run(self._print, goal, tell)

    def cancel(self) -> None:
        """Cancel what runs and wait until it has ended."""
        if self._goal is None:
            return
        handle, self._goal = self._goal, None
        result = handle.get_result_async()
        self._wait(handle.cancel_goal_async(), ANSWER)
        self._wait(result, ANSWER)

    def abandon(self) -> None:
        """Give up waiting for an answer of a node that is gone."""
        self._abandoned.set()

    def _run(self, client: ActionClient, goal: Any, tell: Callable[[Any], None]) -> Any:
        handle = self._sent(client, goal, tell)
        if not handle.accepted:
            raise DriverError("the goal was not accepted")
        self._goal = handle
        result = self._wait(handle.get_result_async(), None).result
        self._goal = None
        if result.error_code:
            raise error_class(result.error_code)(result.error_msg)
        return result

    def _sent(self, client: ActionClient, goal: Any, tell: Callable[[Any], None]) -> Any:
        """Send a goal; where the answer is lost, ask after the goal before sending it again.

        A node that has only just been discovered may take a goal and answer it before its
        answers find the way back.
        """
        for _ in range(SENDINGS - 1):
            name = UUID(uuid=list(uuid4().bytes))
            try:
                return self._wait(client.send_goal_async(goal, tell, name), ANSWER / SENDINGS)
            except LinkTimeout:
                taken = SendGoalAnswer(accepted=True)
                handle = ClientGoalHandle(client, name, taken)
                try:
                    status = self._wait(handle.get_result_async(), 1.0).status
                except LinkTimeout:
                    return handle  # it is known there and runs
                if status != GoalStatus.STATUS_UNKNOWN:
                    return handle  # it has ended already
        return self._wait(client.send_goal_async(goal, tell), ANSWER)

    def _driver_state(self) -> int:
        """Ask for the driver's state, again where no answer comes.

        A driver that was killed stays known for a while, and what is sent before the next one
        is found is lost.
        """
        for left in reversed(range(SENDINGS)):
            try:
                answer = self._call(self._state, GetState.Request(), ANSWER / SENDINGS)
                return int(answer.current_state.id)
            except LinkTimeout:
                if not left:
                    raise
        raise AssertionError("unreachable")

    def _call(self, client: Any, request: Any, seconds: float = ANSWER) -> Any:
        return self._wait(client.call_async(request), seconds)

    def _wait(self, future: Future, seconds: float | None) -> Any:
        done = threading.Event()
        future.add_done_callback(lambda _: done.set())
        began = time.monotonic()
        self._abandoned.clear()
        while not done.wait(0.05):
            self._alive()
            if self._abandoned.is_set():
                raise LinkTimeout("the node is gone; its answer was abandoned")
            if not rclpy.ok():
                raise VegaError("interrupted")
            if seconds is not None and time.monotonic() - began > seconds:
                raise LinkTimeout(f"a node did not answer in {seconds:g} s")
        return future.result()

    def _until(self, ready: Callable[[], bool], what: str) -> None:
        began = time.monotonic()
        while not ready():
            self._alive()
            if time.monotonic() - began > STARTUP:
                raise LinkTimeout(f"{what} did not appear in {STARTUP:g} s")
            time.sleep(0.02)
