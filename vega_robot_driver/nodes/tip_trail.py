# SPDX-License-Identifier: Apache-2.0
"""Where the tip has just been, as measured, and the nozzle: for RViz."""

from __future__ import annotations

import threading
import time

import numpy as np
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from visualization_msgs.msg import MarkerArray

from vega_planner.datatypes import Floats
from vega_planner.nodes.cdr import ARROW, LINE_STRIP, ShapeMarker, marker_array

#: Time between two updates [s].
PERIOD = 0.1
#: Points of the trail, and the least distance between two [m].
LENGTH, STEP = 1500, 2e-4
#: Width of the trail and length of the arrow [m].
WIDTH, NOZZLE = 0.0006, 0.03
_IDLE, _DISPENSING = (0.62, 0.65, 0.70, 1.0), (0.15, 0.75, 0.30, 1.0)
_TRAIL = np.array([1.0, 0.45, 0.1])


class TipTrail:
    """Publishes topic `trail`: namespaces `trail` and `nozzle`, whole each time.

    Args:
        node: Node that publishes.
    """

    def __init__(self, node: Node) -> None:
        qos = QoSProfile(
            depth=1,
            reliability=ReliabilityPolicy.RELIABLE,
            durability=DurabilityPolicy.TRANSIENT_LOCAL,
        )
        self._publisher = node.create_publisher(MarkerArray, "trail", qos)
        self._lock = threading.Lock()
        self._points: list[Floats] = []
        self._next = 0.0

    def clear(self) -> None:
        """Forget where the tip was: a new print begins."""
        with self._lock:
            self._points = []

    def add(self, tip: Floats, axis: Floats, *, dispensing: bool) -> None:
        """Take a measurement.

        Args:
            tip: Tip in frame `base` [m], shape (3,).
            axis: Unit vector from the tip back along the nozzle, shape (3,).
            dispensing: Whether material comes out.
        """
        with self._lock:
            if not self._points or np.linalg.norm(tip - self._points[-1]) >= STEP:
                self._points = [*self._points[1 - LENGTH :], tip]
            now = time.monotonic()
            if now < self._next:
                return
            self._next = now + PERIOD
            points = np.array([*self._points, tip])
        color = _DISPENSING if dispensing else _IDLE
        arrow = np.array([tip + NOZZLE * axis, tip])
        markers = [
            ShapeMarker(
                "trail", 0, LINE_STRIP, points, (*_TRAIL, 1.0), "base", WIDTH, fading(len(points))
            ),
            ShapeMarker("nozzle", 0, ARROW, arrow, color, "base", 0.002),
        ]
        self._publisher.publish(marker_array(markers, clear=False))


def fading(count: int) -> Floats:
    """Colours of a trail of so many points, the oldest nearly gone, shape (n, 4)."""
    opacity = np.linspace(0.1, 1.0, count)
    return np.column_stack([np.tile(_TRAIL, (count, 1)), opacity])
