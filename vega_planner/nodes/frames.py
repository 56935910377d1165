# SPDX-License-Identifier: Apache-2.0
"""Frames `base` and `part` for RViz, where tf2 is there."""

from __future__ import annotations

from geometry_msgs.msg import Transform, TransformStamped, Vector3
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from vega_planner.datatypes import Floats
from vega_planner.nodes.conversions import pose_to_msg

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # the ROS 2 wheels have no tf2; nothing on such a machine shows frames
    TFMessage = None


class FramePublisher:
    """Publishes where the part stands.

    Args:
        node: Node that publishes.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._publisher = None
        if TFMessage is not None:
            qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
            self._publisher = node.create_publisher(TFMessage, "/tf_static", qos)

    def publish(self, T_base_part: Floats) -> None:
        """Publish frame `part` in frame `base`, shape (4, 4), metres."""
        if self._publisher is None:
            return
        pose = pose_to_msg(T_base_part)
        place = Vector3(x=pose.position.x, y=pose.position.y, z=pose.position.z)
        frame = TransformStamped(
            child_frame_id="part",
            transform=Transform(translation=place, rotation=pose.orientation),
        )
        frame.header.frame_id = "base"
        frame.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(TFMessage(transforms=[frame]))
