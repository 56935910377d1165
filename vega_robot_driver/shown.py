# SPDX-License-Identifier: Apache-2.0
"""What a machine shows after each cycle: its status page and its checkpoints."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence

from vega_robot_driver.checkpoint import Checkpoint
from vega_robot_driver.executor import STATES, Executor
from vega_robot_driver.status import StatusPage

#: Time between two checkpoints while printing [s]: at most so much is lost with the power.
CHECKPOINT_PERIOD = 0.05


class Shown:
    """Shows an executor.

    Args:
        page: The status page.
        post: Takes a checkpoint that is due.
    """

    def __init__(self, page: StatusPage, post: Callable[[Checkpoint], None]) -> None:
        self._page, self._post = page, post
        self._last = (0.0, -2, "")
        self._idle_on = 0

    def show(
        self,
        executor: Executor,
        now: float,
        *,
        overruns: int = 0,
        lateness: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> None:
        """Show the state after a cycle, and post a checkpoint where one is due.

        Args:
            executor: The machine.
            now: Time of a steady clock [s].
            overruns: Cycles that began too late.
            lateness: Median, 99th percentile and largest lateness [s].
        """
        record = self._page.record
        if executor.gate and executor.rate == 0.0:
            self._idle_on += 1
        job, path, axes = executor.job, executor.path, len(executor.positions)
        record["pid"], record["stamp"] = os.getpid(), now
        record["state"], record["gate"] = STATES.index(executor.state), executor.gate
        record["u"], record["rate"], record["done"] = executor.u, executor.rate, executor.done_u
        record["duration"] = job.duration_s if job else 0.0
        record["path"], record["layer"] = path, job.layer_of(path) if job else -1
        record["paths_done"] = executor.paths_done
        record["axes"] = axes
        record["positions"][0, :axes] = executor.positions
        record["targets"][0, :axes] = executor.targets
        record["pressure"], record["cycles"] = executor.pressure, executor.cycles
        record["clock"] = executor.cycles * executor.motion.dt
        record["idle_on_cycles"], record["overruns"] = self._idle_on, overruns
        record["wrong_counters"] = executor.motion.quality.wrong_counters
        record["lateness"][0] = lateness
        record["homing_epoch"] = executor.motion.homing_epoch
        record["job"], record["detail"] = executor.digest.encode(), executor.detail.encode()[:200]
        self._page.publish()
        self._checkpoint(executor, path, now)

    def _checkpoint(self, executor: Executor, path: int, now: float) -> None:
        if not executor.digest or executor.state in ("off", "idle", "homing"):
            return
        when, last_path, last_state = self._last
        due = executor.state == "printing" and now - when >= CHECKPOINT_PERIOD
        if due or path != last_path or executor.state != last_state:
            self._post(executor.checkpoint())
            self._last = (now, path, executor.state)
