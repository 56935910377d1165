# SPDX-License-Identifier: Apache-2.0
"""The bead printed so far, as lines for RViz.

Each message adds only what is new, so that a long print stays cheap to send and to draw;
who joins late is sent the whole.
"""

from __future__ import annotations

import itertools
import threading
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from visualization_msgs.msg import MarkerArray

from vega_planner.datatypes import Floats
from vega_planner.nodes.cdr import LINE_STRIP, ShapeMarker, marker_array
from vega_planner.nodes.markers import layer_color, line_pieces
from vega_planner.viewer.level_of_detail import kept_rows
from vega_robot_driver.job import PrintJob
from vega_robot_driver.status import MachineStatus

#: Time between two updates [s].
PERIOD = 0.5
#: Width the bead is drawn with [m].
WIDTH = 0.0012
#: Most points of a line, so that the one that grows is cheap to send again.
MOST_POINTS = 1000
#: Most points of a print; straight stretches of longer ones are thinned.
BUDGET = 200_000


@dataclass(frozen=True, eq=False)
class Bead:
    """A line of printed material.

    Attributes:
        points: Tip positions in frame `base` [m], shape (n, 3), n >= 2.
        times: Path time at each [s], rising, shape (n,).
        layer: Its layer, 0 where unknown.
    """

    points: Floats
    times: Floats
    layer: int

    def until(self, time_s: float) -> Floats:
        """Points of what is printed at a time, the last one where the tip is."""
        row = int(np.searchsorted(self.times, time_s, side="right"))
        if row >= len(self.times):
            return self.points
        share = (time_s - self.times[row - 1]) / (self.times[row] - self.times[row - 1])
        tip = self.points[row - 1] + share * (self.points[row] - self.points[row - 1])
        return np.vstack([self.points[:row], tip])


def beads_of(job: PrintJob, tips: Floats, budget: int = BUDGET) -> list[Bead]:
    """Cut the motion of a job into the beads it lays, in print order.

    Args:
        job: The job.
        tips: Tip position at each of its samples in frame `base` [m], shape (n, 3).
        budget: Most points wanted in all.
    """
    joined = job.extrude[1:] & (job.path_id[1:] >= 0)
    on = np.concatenate([[False], joined, [False]])
    spans = np.flatnonzero(on[1:] != on[:-1]).reshape(-1, 2)
    rows = [np.arange(first, last + 1) for first, last in spans]
    if not rows:
        return []
    every = np.concatenate(rows)
    ends = np.zeros(len(every), dtype=bool)
    bounds = np.concatenate([[0], np.cumsum([len(one) for one in rows])])
    ends[bounds[:-1]] = ends[bounds[1:] - 1] = True
    chosen = kept_rows(tips[every], ends, budget)
    kept, beads = every[chosen], []
    cuts = np.searchsorted(chosen, bounds)
    for first, last in itertools.pairwise(cuts):
        line = kept[first:last]
        layer = max(job.layer_of(int(job.path_id[line[-1]])), 0)
        for piece in line_pieces(len(line), MOST_POINTS):
            beads.append(Bead(tips[line[piece]], job.times[line[piece]], layer))
    return beads


class PrintedBeads:
    """Publishes topic `printed`.

    Args:
        node: Node that publishes.
    """

    def __init__(self, node: Node) -> None:
        qos = QoSProfile(
            depth=50,  # a slow listener may fall so many additions behind
            reliability=ReliabilityPolicy.RELIABLE,
            durability=DurabilityPolicy.TRANSIENT_LOCAL,
        )
        events = PublisherEventCallbacks(matched=self._matched)
        self._lock = threading.Lock()
        self._beads: list[Bead] = []
        self._layers = 1
        self._complete = 0
        self._whole = True
        self._final = -1.0
        self._next = 0.0
        self._publisher = node.create_publisher(
            MarkerArray, "printed", qos, event_callbacks=events
        )

    def start(self, job: PrintJob, tips: Floats) -> None:
        """Take a job and the tip positions of its samples in frame `base` [m], (n, 3)."""
        beads = beads_of(job, tips)
        with self._lock:
            self._beads = beads
            self._layers = int(job.path_layer.max(initial=0)) + 1
            self._whole, self._final = True, -1.0

    def show(self, status: MachineStatus) -> None:
        """Publish what is new, or everything to a new listener; nothing where nobody looks."""
        now = time.monotonic()
        with self._lock:
            ending = not status.active and status.done != self._final
            if not ending and (
                now < self._next
                or not (self._whole or status.active)
                or self._publisher.get_subscription_count() == 0
            ):
                return
            self._next = now + PERIOD
            if ending:
                self._final = status.done
            # What stays behind for late joiners is whole.
            whole = self._whole or ending
            markers = self._markers(0 if whole else self._complete, status.done)
            self._whole = False
        if markers or whole:
            self._publisher.publish(marker_array(markers, clear=whole))

    def _markers(self, first: int, done: float) -> list[ShapeMarker]:
        markers = []
        for number in range(first, len(self._beads)):
            bead = self._beads[number]
            if bead.times[0] >= done:
                break
            color = layer_color(bead.layer, self._layers)
            points: Any = bead.until(done)
            markers.append(
                ShapeMarker("printed", number, LINE_STRIP, points, color, "base", WIDTH)
            )
            self._complete = number + (bead.times[-1] <= done)
        return markers

    def _matched(self, change: Any) -> None:
        if change.total_count_change > 0:
            with self._lock:
                self._whole = True
