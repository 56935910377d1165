# SPDX-License-Identifier: Apache-2.0
"""The bead printed so far, as lines for RViz."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from vega_planner.datatypes import Floats
from vega_planner.nodes.cdr import LINE_STRIP, ShapeMarker, marker_array
from vega_planner.nodes.markers import layer_color, line_pieces
from vega_robot_driver.job import PrintJob
from vega_robot_driver.status import MachineStatus

#: Time between two updates [s].
PERIOD = 1.0
#: Width the bead is drawn with [m].
WIDTH = 0.0012


class PrintedBeads:
    """Publishes the printed part of a job, whole, so that late joiners see all of it.

    Args:
        publisher: Latched publisher of visualization_msgs/MarkerArray.
    """

    def __init__(self, publisher: Any) -> None:
        self._publisher = publisher
        self._job: PrintJob | None = None
        self._tips: Floats = np.zeros((0, 3))
        self._shown = -1.0
        self._next = 0.0

    def start(self, job: PrintJob, tips: Floats) -> None:
        """Take a job and the tip positions of its samples in frame `base` [m], (n, 3)."""
        self._tips, self._shown = tips, -1.0
        self._job = job

    def show(self, status: MachineStatus) -> None:
        """Publish what is printed, where it changed and someone looks."""
        job, now = self._job, time.monotonic()
        if job is None or now < self._next or status.done <= self._shown:
            return
        if self._publisher.get_subscription_count() == 0 and status.active:
            return
        self._next, self._shown = now + PERIOD, status.done
        upto = int(np.searchsorted(job.times, status.done, side="right"))
        bounds = np.flatnonzero(np.diff(job.path_id[:upto])) + 1
        markers: list[ShapeMarker] = []
        layers = int(job.path_layer.max(initial=0)) + 1
        for rows in np.split(np.arange(upto), bounds):
            path = int(job.path_id[rows[0]]) if len(rows) else -1
            if path < 0 or len(rows) < 2:
                continue
            color = layer_color(max(job.layer_of(path), 0), layers)
            for piece in line_pieces(self._tips[rows]):
                number = len(markers)
                markers.append(
                    ShapeMarker("printed", number, LINE_STRIP, piece, color, "base", WIDTH)
                )
        self._publisher.publish(marker_array(markers))
