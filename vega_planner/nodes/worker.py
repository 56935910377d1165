# SPDX-License-Identifier: Apache-2.0
"""Planning in a process of its own.

The node stays responsive whatever a stage does, a stage that crashes in native code does
not take the node with it, and a job that does not answer a cancel request can be killed.
The process imports the planner once and waits for jobs.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory

from vega_planner.datatypes import (
    Floats,
    Ints,
    Layer,
    PrintTrajectory,
    ToolpathSet,
)
from vega_planner.errors import BadMesh, Busy, Cancelled, InvalidInput, VegaError
from vega_planner.progress import Progress, Report
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
        markers: The latched marker arrays, serialized: layers and toolpath.
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
                [sys.executable, "-m", "vega_planner.nodes.worker", str(theirs.fileno())],
                pass_fds=(theirs.fileno(),),
                stdin=subprocess.DEVNULL,
                start_new_session=True,  # a terminal's ctrl-c is for the node
            )
        self._link = Connection(mine.detach())


class _Jobs:
    """The worker's side: reads jobs, runs them, listens for the word to stop."""

    def __init__(self, link: Connection) -> None:
        self._link = link
        self._stop = threading.Event()
        self._jobs: list[PlanRequest] = []
        self._arrived = threading.Condition()
        self._last_report = 0.0

    def listen(self) -> None:
        """Read what the node sends; end with it."""
        while True:
            try:
                message = self._link.recv()
            except (EOFError, OSError):
                os._exit(0)
            if message == "cancel":
                self._stop.set()
                continue
            with self._arrived:
                self._jobs.append(message)
                self._arrived.notify()

    def run(self) -> None:
        """Run one job after the other."""
        while True:
            with self._arrived:
                self._arrived.wait_for(lambda: bool(self._jobs))
                request = self._jobs.pop()
            self._stop.clear()
            self._last_report = 0.0
            try:
                self._link.send(("done", _outcome(request, self._report)))
            except VegaError as error:
                self._link.send(("error", error))
            except MemoryError:
                self._link.send(("error", VegaError("not enough memory for this plan")))
            except Exception as error:
                text = f"unexpected {type(error).__name__}: {error}"
                self._link.send(("error", VegaError(text)))

    def _report(self, progress: Progress) -> None:
        if self._stop.is_set():
            raise Cancelled("planning was cancelled")
        now = time.monotonic()
        if now - self._last_report >= REPORT_PERIOD or progress.fraction >= 1.0:
            self._last_report = now
            self._link.send(("progress", progress))


def _outcome(request: PlanRequest, report: Report) -> PlanOutcome:
    import vega_planner
    from vega_planner.nodes.cdr import marker_array
    from vega_planner.nodes.markers import layer_markers, toolpath_markers

    with TemporaryDirectory(prefix="vega_plan_") as scratch:
        source, settings = _sources(request, Path(scratch))
        plan = vega_planner.plan(source, settings, report)
    folder = ""
    if request.folder:
        report(Progress("writing", 1.0))
        folder = str(plan.write(request.folder))
    return PlanOutcome(
        status=plan.printability.status,
        folder=folder,
        summary=json.dumps(plan.summary, ensure_ascii=False),
        certificate=json.dumps(plan.certificate, ensure_ascii=False),
        sheets=plan.stack.sheets,
        toolpaths=plan.toolpaths,
        trajectory=plan.trajectory,
        markers={
            "layers": marker_array(layer_markers(plan.stack, plan.printability)),
            "toolpath": marker_array(toolpath_markers(plan.toolpaths)),
        },
    )


def _sources(request: PlanRequest, scratch: Path) -> tuple[str, Settings]:
    """Put what came in a message into files, as the planner reads them."""
    from vega_planner.results.ply import mesh_ply

    source, settings = request.mesh, request.settings
    if not source:
        if request.vertices is None or request.faces is None or len(request.faces) == 0:
            raise BadMesh("the goal names no mesh and carries none")
        source = str(scratch / "inline.ply")
        Path(source).write_bytes(mesh_ply(request.vertices, request.faces))
        settings = settings.updated({"part": {"unit": "mm"}})
    elif not Path(source).is_file():
        raise BadMesh(f"mesh '{source}' is not there")
    if request.restrained_faces:
        faces = scratch / "faces.txt"
        faces.write_text("\n".join(map(str, request.restrained_faces)) + "\n")
        chosen = [spec for spec in settings.part.brr if spec not in ("auto", "none")]
        settings = settings.updated({"part": {"brr": [*chosen, f"faces:{faces}"]}})
    return source, settings


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


def main() -> None:
    """Run the worker process on the socket whose number is the argument."""
    link = Connection(int(sys.argv[1]))
    jobs = _Jobs(link)
    threading.Thread(target=jobs.listen, daemon=True).start()
    with contextlib.suppress(ImportError):  # a job will tell what is missing
        import vega_planner.nodes.markers
        import vega_planner.part
        import vega_planner.pipeline
        import vega_planner.robot.robot
        import vega_planner.trajectory  # noqa: F401
    jobs.run()


if __name__ == "__main__":
    main()
