# SPDX-License-Identifier: Apache-2.0
"""Feedback of an action that reaches its client from the first stage on."""

from __future__ import annotations

import time

from rclpy.node import Node
from rclpy.qos import QoSProfile

#: Keeps what a client was too busy to take: a small part passes ten stages in half a second.
EVERY_STAGE = QoSProfile(depth=200)

#: Time a client's subscription may take to be discovered [s].
DISCOVERY = 1.0


def await_listener(node: Node, action: str) -> None:
    """Wait until somebody listens to the feedback of an action, but not for long.

    A goal may arrive before the subscription of its client is discovered; what is published
    before that is lost.

    Args:
        node: The node that serves the action.
        action: Name of the action, relative to the node's namespace.
    """
    topic = f"{action}/_action/feedback"
    deadline = time.monotonic() + DISCOVERY
    while node.count_subscribers(topic) == 0 and time.monotonic() < deadline:
        time.sleep(0.01)
