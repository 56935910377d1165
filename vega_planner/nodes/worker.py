# SPDX-License-Identifier: Apache-2.0
"""Planning in a process of its own.

The node stays responsive whatever a stage does, a stage that crashes in native code does
not take the node with it, and a job that does not answer a cancel request can be killed.
The process imports the planner once and waits for jobs.
"""

from __future__ import annotations

import contextlib
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing.connection import Connection

from vega_planner.datatypes import (
    Floats,
    Ints,
    Layer,
    PrintTrajectory,
    ToolpathSet,
)
from vega_planner.errors import Busy, Cancelled, InvalidInput, VegaError
from vega_planner.progress import Report
from vega_planner.settings import Settings

#: Time a job may take to notice that it is cancelled, before its process is killed [s].
CANCEL_GRACE = 3.0
#: Time between two progress reports of a job [s].
REPORT_PERIOD = 0.05


@dataclass(frozen=True, eq=False)
class PlanRequest:
    """A job for the worker.

    Attributes:
        mesh: Path of a mesh file, or empty.
        vertices: Points [mm] of a mesh sent instead, shape (n, 3).
        faces: Its triangles, shape (m, 3).
        restrained_faces: Faces of the restraint region, over the settings' own.
        settings: What to plan with.
        folder: Where to write the result folder; empty for nowhere.
    """

    mesh: str
    vertices: Floats | None
    faces: Ints | None
    restrained_faces: tuple[int, ...]
    settings: Settings
    folder: str = ""


@dataclass(frozen=True, eq=False)
class PlanOutcome:
    """What comes back of a plan.

    Attributes:
        status: Printability: "fully", "conditionally" or "not".
        folder: Result folder, or empty.
        summary: Text of summary.json.
        certificate: Text of certificate.json.
        sheets: All layers.
        toolpaths: Passes and travel.
        trajectory: Joint motion.
        markers: The latched marker arrays by topic, serialized.
    """

    status: str
    folder: str
    summary: str
    certificate: str
    sheets: tuple[Layer, ...]
    toolpaths: ToolpathSet
    trajectory: PrintTrajectory
    markers: dict[str, bytes] = field(default_factory=dict)


class PlanWorker:
    """The node's side of the worker process."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._process: subprocess.Popen | None = None
        self._link: Connection | None = None
        self._closed = False
        self._start()

    def plan(
        self,
        request: PlanRequest,
        report: Report,
        cancelled: Callable[[], bool] = lambda: False,
    ) -> PlanOutcome:
        """Plan, one job at a time.

        Args:
            request: The job.
            report: Told how far it is.
            cancelled: Asked often; once true, the job is stopped.

        Raises:
            Busy: If a job is running.
            Cancelled: If it was stopped.
            VegaError: What the planner raised.
        """
        if not self._lock.acquire(blocking=False):
            raise Busy("another job is being planned; wait for its end or cancel it")
        try:
            return self._plan(request, report, cancelled)
        finally:
            self._lock.release()

    def close(self) -> None:
        """End the process."""
        self._closed = True
        self._kill()

    def _plan(
        self, request: PlanRequest, report: Report, cancelled: Callable[[], bool]
    ) -> PlanOutcome:
        if self._process is None or self._process.poll() is not None:
            self._start()
        assert self._link is not None
        told: float | None = None
        try:
            self._link.send(request)
            while True:
                if not self._link.poll(0.02):
                    if told is None and cancelled():
                        told = time.monotonic()
                        self._link.send("cancel")
                    elif told is not None and time.monotonic() - told > CANCEL_GRACE:
                        self._restart()
                        raise Cancelled("planning was cancelled; its process was ended")
                    continue
                kind, value = self._link.recv()
                if kind == "progress":
                    if told is None and cancelled():
                        told = time.monotonic()
                        self._link.send("cancel")
                    report(value)
                elif kind == "error":
                    raise value
                elif told is not None:
                    raise Cancelled("planning was cancelled")
                else:
                    return value
        except (EOFError, OSError) as error:
            if isinstance(error, VegaError):
                raise
            status = self._process.wait() if self._process else "?"
            self._restart()
            raise VegaError(f"the planning process died with status {status}") from error

    def _restart(self) -> None:
        self._kill()
        if not self._closed:
            self._start()

    def _kill(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()
        if self._link is not None:
            with contextlib.suppress(OSError):
                self._link.close()

    def _start(self) -> None:
        mine, theirs = socket.socketpair()
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "vega_planner.nodes.worker_process", str(theirs.fileno())],
                pass_fds=(theirs.fileno(),),
                stdin=subprocess.DEVNULL,
                start_new_session=True,  # a terminal's ctrl-c is for the node
            )
        self._link = Connection(mine.detach())


def mesh_path(text: str) -> str:
    """Turn a path or a file URI into a path.

    Raises:
        InvalidInput: If it is a URI of another kind.
    """
    from urllib.parse import unquote, urlparse

    if "://" not in text:
        return text
    parsed = urlparse(text)
    if parsed.scheme != "file" or parsed.netloc not in ("", "localhost"):
        raise InvalidInput(f"mesh '{text}'; choices: a path or a file:///... URI")
    return unquote(parsed.path)
