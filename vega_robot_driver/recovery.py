# SPDX-License-Identifier: Apache-2.0
"""What a killed process still told: its last cycle, brought into the checkpoint."""

from __future__ import annotations

from pathlib import Path

from vega_planner.errors import VegaError
from vega_robot_driver.checkpoint import Checkpoint, read_checkpoint, write_checkpoint
from vega_robot_driver.status import StatusPage


def recover_checkpoint(folder: Path) -> Checkpoint | None:
    """Bring the checkpoint of a state folder up to the last cycle that was shown.

    Checkpoints reach the disk some milliseconds after what they tell of, and the status page
    is memory that outlives a killed process: after `kill -9` nothing is printed twice. After a
    loss of power the page is as old as the disk's, and the checkpoint counts.

    Returns:
        The checkpoint, None where there never was one.
    """
    path = folder / "checkpoint.json"
    try:
        checkpoint = read_checkpoint(path)
        shown = StatusPage(folder).read()
    except VegaError:
        return _readable(path)
    later = (
        checkpoint is not None
        and checkpoint.unfinished
        and shown.job == checkpoint.job
        and shown.homing_epoch == checkpoint.homing_epoch
        and shown.state not in ("off", "idle")
        and shown.done > checkpoint.done
    )
    if not later:
        return checkpoint
    recovered = Checkpoint(
        job=shown.job,
        done=shown.done,
        path=shown.path,
        paths_done=shown.paths_done,
        dispensing=shown.dispenser_on,
        homing_epoch=shown.homing_epoch,
        state=shown.state,
        reason=shown.detail or "the real-time process was killed",
    )
    write_checkpoint(path, recovered)
    return recovered


def _readable(path: Path) -> Checkpoint | None:
    try:
        return read_checkpoint(path)
    except VegaError:
        return None
