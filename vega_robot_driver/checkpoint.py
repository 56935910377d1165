# SPDX-License-Identifier: Apache-2.0
"""What survives a crash: how far a print is, written whole or not at all."""

from __future__ import annotations

import contextlib
import json
import os
import threading
from dataclasses import asdict, dataclass
from pathlib import Path

from vega_planner.errors import Refused


@dataclass(frozen=True)
class Checkpoint:
    """Where a print stands.

    Attributes:
        job: Hash of the job.
        done: Path time [s] up to which everything that should be deposited is.
        path: Pass at that time, -1 on travel.
        paths_done: Number of completed passes.
        dispensing: Whether the dispenser was on when this was written.
        homing_epoch: The axes' homing the path times belong to.
        state: State of the machine in a word.
        reason: Why it stopped, or empty.
    """

    job: str
    done: float
    path: int
    paths_done: int
    dispensing: bool
    homing_epoch: int
    state: str
    reason: str = ""

    @property
    def unfinished(self) -> bool:
        """Whether there is something to resume."""
        return bool(self.job) and self.state != "done"

    def check_resumable(self, job: str, homing_epoch: int) -> None:
        """Refuse to resume another job, or one on axes that were homed anew.

        Raises:
            Refused: Saying what differs.
        """
        if not self.unfinished:
            raise Refused("no interrupted print to resume")
        if self.job != job:
            raise Refused(f"the interrupted print is job {self.job[:12]}, not {job[:12]}")
        if self.homing_epoch != homing_epoch:
            raise Refused(
                f"the axes were homed after the interruption (epoch {self.homing_epoch}, "
                f"now {homing_epoch}); the print cannot be resumed in place"
            )


def write_checkpoint(path: Path, checkpoint: Checkpoint) -> None:
    """Replace the file at once; it is on the disk when this returns."""
    fresh = path.with_suffix(".new")
    with fresh.open("w", encoding="utf-8") as file:
        json.dump(asdict(checkpoint), file)
        file.flush()
        os.fsync(file.fileno())
    fresh.replace(path)
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def read_checkpoint(path: Path) -> Checkpoint | None:
    """Read a checkpoint; None where there never was one.

    Raises:
        Refused: If the file is there but damaged.
    """
    try:
        return Checkpoint(**json.loads(path.read_text(encoding="utf-8")))
    except FileNotFoundError:
        return None
    except (ValueError, TypeError) as error:
        raise Refused(f"checkpoint {path} is damaged: {error}") from error


class CheckpointWriter:
    """Writes checkpoints on a thread of its own, so that a slow disk delays no cycle.

    Args:
        path: The file.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._latest: Checkpoint | None = None
        self._wake = threading.Condition()
        self._ended = False
        self._thread = threading.Thread(target=self._run, name="checkpoints", daemon=True)
        self._thread.start()

    def post(self, checkpoint: Checkpoint) -> None:
        """Hand over the latest checkpoint; older ones that still wait are dropped."""
        with self._wake:
            self._latest = checkpoint
            self._wake.notify()

    def close(self) -> None:
        """Write what waits and end."""
        with self._wake:
            self._ended = True
            self._wake.notify()
        self._thread.join(timeout=5.0)

    def _run(self) -> None:
        while True:
            with self._wake:
                self._wake.wait_for(lambda: self._ended or self._latest is not None)
                checkpoint, self._latest = self._latest, None
                if checkpoint is None:
                    return
            with contextlib.suppress(OSError):  # a full disk must not stop the machine
                write_checkpoint(self._path, checkpoint)
