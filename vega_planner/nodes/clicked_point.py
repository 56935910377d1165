# SPDX-License-Identifier: Apache-2.0
"""A point clicked in RViz becomes a SPEC for the command line."""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import PointStamped
from rclpy.node import Node
from std_msgs.msg import String

from vega_planner.datatypes import Floats
from vega_planner.units import m_to_mm


class ClickedPoint:
    """Answers `clicked_point` (RViz's tool Publish Point) on topic `restraint_spec`.

    Args:
        node: Node that listens.

    Attributes:
        T_base_part: Pose of the part in frame `base`, shape (4, 4), metres; None before
            the first plan.
    """

    def __init__(self, node: Node) -> None:
        self.T_base_part: Floats | None = None
        self._node = node
        self._publisher = node.create_publisher(String, "restraint_spec", 10)
        node.create_subscription(PointStamped, "clicked_point", self._clicked, 10)

    def _clicked(self, message: PointStamped) -> None:
        point = np.array([message.point.x, message.point.y, message.point.z, 1.0])
        frame = message.header.frame_id
        if frame == "base" and self.T_base_part is not None:
            point = np.linalg.solve(self.T_base_part, point)
        elif frame != "part":
            self._node.get_logger().warning(
                f"a point was clicked in frame '{frame}'; choices: part, and base after a plan"
            )
            return
        values = (f"{value:.3f}".rstrip("0").rstrip(".") for value in m_to_mm(point[:3]))
        spec = "point:" + ",".join("0" if value == "-0" else value for value in values)
        self._node.get_logger().info(f"restraint region round the clicked point: --brr {spec}")
        self._publisher.publish(String(data=spec))
