# SPDX-License-Identifier: Apache-2.0
"""Node `planner`: action `plan_layers`, latched layers and toolpath for RViz."""

from __future__ import annotations

import threading

import rclpy
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from vega_msgs.action import PlanLayers
from vega_planner.errors import Cancelled, VegaError
from vega_planner.nodes.clicked_point import ClickedPoint
from vega_planner.nodes.conversions import error_to_msg, request_from_msg, result_to_msg
from vega_planner.nodes.feedback import EVERY_STAGE, await_listener
from vega_planner.nodes.frames import FramePublisher
from vega_planner.nodes.parameters import declare_settings, read_settings
from vega_planner.nodes.plan_markers import TOPICS
from vega_planner.nodes.worker import PlanWorker
from vega_planner.progress import Progress

#: Late joiners get the last array, whole.
LATCHED = QoSProfile(
    depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL
)


class PlannerNode(Node):
    """Plans one job at a time in a worker process."""

    def __init__(self) -> None:
        super().__init__("planner")
        declare_settings(self)
        self._worker = PlanWorker()
        self._latched = {
            name: self.create_publisher(MarkerArray, name, LATCHED) for name in TOPICS
        }
        self._frames = FramePublisher(self)
        self._clicked = ClickedPoint(self)
        self._shown: dict[str, bytes] = {}
        group = ReentrantCallbackGroup()
        self._running = threading.Lock()
        self.create_service(Trigger, "~/republish", self._republish, callback_group=group)
        self._server = ActionServer(
            self,
            PlanLayers,
            "plan_layers",
            self._execute,
            callback_group=group,
            goal_callback=lambda _: GoalResponse.ACCEPT,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
            feedback_pub_qos_profile=EVERY_STAGE,
        )

    def close(self) -> None:
        """End the worker process."""
        self._worker.close()

    def _execute(self, goal: ServerGoalHandle) -> PlanLayers.Result:
        def report(progress: Progress) -> None:
            if goal.is_active:
                goal.publish_feedback(
                    PlanLayers.Feedback(
                        stage=progress.stage,
                        progress=progress.fraction,
                        layers=progress.layers,
                        detail=progress.detail,
                    )
                )

        await_listener(self, "plan_layers")
        try:
            request = request_from_msg(goal.request, read_settings(self))
            outcome = self._worker.plan(request, report, lambda: goal.is_cancel_requested)
            result = result_to_msg(outcome, goal.request)
        except Cancelled as error:
            if goal.is_cancel_requested:
                goal.canceled()
            else:
                goal.abort()
            return error_to_msg(error)
        except VegaError as error:
            self.get_logger().error(str(error))
            goal.abort()
            return error_to_msg(error)
        except Exception as error:  # a bug must not look like an empty plan
            self.get_logger().error(f"unexpected {type(error).__name__}: {error}")
            goal.abort()
            return error_to_msg(VegaError(f"unexpected {type(error).__name__}: {error}"))
        self._shown = outcome.markers
        self._frames.publish(outcome.trajectory.T_base_part)
        self._clicked.T_base_part = outcome.trajectory.T_base_part
        self._publish()
        goal.succeed()
        return result

    def _publish(self) -> None:
        for name, data in self._shown.items():
            self._latched[name].publish(data)

    def _republish(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._publish()
        response.success = bool(self._shown)
        response.message = "published again" if self._shown else "nothing is planned yet"
        return response


def main() -> int:
    """Run the node until it is interrupted."""
    rclpy.init()
    node = PlannerNode()
    executor = MultiThreadedExecutor(num_threads=4)
    executor.add_node(node)
    try:
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.close()
        rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
