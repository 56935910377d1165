# SPDX-License-Identifier: Apache-2.0
"""The planning process itself: reads jobs, runs them, listens for the word to stop."""

from __future__ import annotations

import contextlib
import json
import os
import sys
import threading
import time
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import TemporaryDirectory

from vega_planner.errors import BadMesh, Cancelled, VegaError
from vega_planner.nodes.worker import REPORT_PERIOD, PlanOutcome, PlanRequest
from vega_planner.progress import Progress, Report
from vega_planner.settings import Settings


class _Jobs:
    """The worker's side: reads jobs, runs them, listens for the word to stop."""

    def __init__(self, link: Connection) -> None:
        self._link = link
        self._stop = threading.Event()
        self._jobs: list[PlanRequest] = []
        self._arrived = threading.Condition()
        self._last_report, self._stage = 0.0, ""

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
            self._last_report, self._stage = 0.0, ""
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
        due = now - self._last_report >= REPORT_PERIOD or progress.fraction >= 1.0
        if due or progress.stage != self._stage:
            self._last_report, self._stage = now, progress.stage
            self._link.send(("progress", progress))


def _outcome(request: PlanRequest, report: Report) -> PlanOutcome:
    import vega_planner
    from vega_planner.nodes.plan_markers import plan_markers

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
        markers=plan_markers(
            plan.stack, plan.printability, plan.toolpaths, plan.trajectory, plan.cell
        ),
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
