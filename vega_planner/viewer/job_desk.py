# SPDX-License-Identifier: Apache-2.0
"""Planning and printing for the viewer's buttons, one job at a time."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path

from vega_planner.errors import Cancelled, InvalidInput, VegaError
from vega_planner.progress import Progress
from vega_planner.settings import Settings
from vega_planner.viewer.job import RUNNING, JobPort, JobState, MachineChoice

#: Shortest time between two words of progress [s].
_REPORT_S = 0.1


class JobDesk:
    """Starts and stops jobs, and knows where they stand.

    Attributes:
        state: What the machine last said.
        planning: True while a plan is made.
        progress: How far the plan is, 0 to 1.
        remark: What a person should know of it.
    """

    def __init__(self, make_job: Callable[[], JobPort]) -> None:
        """Start with nothing to do.

        Args:
            make_job: Makes what plans and prints, on first use.
        """
        self.state = JobState()
        self.planning = False
        self.progress = 0.0
        self.remark = ""
        self._starting = False
        self._make_job = make_job
        self._job: JobPort | None = None
        self._cancel = threading.Event()
        self._lock = threading.Lock()

    @property
    def job(self) -> JobPort:
        """What plans and prints; made on first use."""
        with self._lock:
            if self._job is None:
                self._job = self._make_job()
            return self._job

    @property
    def running(self) -> bool:
        """Whether a print is under way."""
        return self.state.state in RUNNING

    @property
    def idle(self) -> bool:
        """Whether a job can be started."""
        return not (self.planning or self._starting or self.running)

    def look(self) -> None:
        """Ask where the print stands."""
        if self._job is not None:
            self.state = self._job.progress()

    def start_plan(
        self,
        mesh: Path,
        settings: Settings,
        folder: Path,
        done: Callable[[Path], None],
        failed: Callable[[str], None],
    ) -> None:
        """Plan in a thread of its own.

        Args:
            mesh: Mesh file.
            settings: What to plan with.
            folder: Result folder.
            done: Receives the folder when it is written.
            failed: Receives the reason when it is not.

        Raises:
            InvalidInput: If a job is running.
        """
        self._refuse_a_second()
        self._cancel.clear()
        self.planning, self.progress, self.remark = True, 0.0, ""

        def work() -> None:
            try:
                done(self.job.plan(mesh.absolute(), settings, folder, self._report()))
                self.remark = ""
            except VegaError as error:
                stage = f" ({error.stage})" if error.stage else ""
                self.remark = f"not planned{stage}: {error}"
                failed(str(error))
            finally:
                self.planning = False

        threading.Thread(target=work, daemon=True, name="plan").start()

    def start_print(self, folder: Path, machine: MachineChoice) -> None:
        """Print a result folder.

        Raises:
            VegaError: If a job is running, or the robot refuses this one.
        """
        self._refuse_a_second()
        self._starting, self.remark = True, "starting the print"
        try:
            self.job.print(folder.absolute(), machine)
        finally:
            self._starting, self.remark = False, ""

    def stop(self) -> None:
        """Stop planning or printing.

        Raises:
            VegaError: If nothing runs, or the robot does not answer.
        """
        if self.planning:
            self._cancel.set()
            return
        self.job.stop()

    def close(self) -> None:
        """Stop everything and let go of the job."""
        self._cancel.set()
        if self._job is not None:
            self._job.close()

    def _refuse_a_second(self) -> None:
        if not self.idle:
            raise InvalidInput("a job is running; stop it first")

    def _report(self) -> Callable[[Progress], None]:
        said = 0.0

        def report(progress: Progress) -> None:
            nonlocal said
            if self._cancel.is_set():
                raise Cancelled("stopped; nothing was written")
            if time.monotonic() - said > _REPORT_S:
                said = time.monotonic()
                self.progress = progress.fraction
                layers = f", {progress.layers} layers" if progress.layers else ""
                self.remark = f"planning: {progress.stage} {progress.detail}{layers}"

        return report
