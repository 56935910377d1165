# SPDX-License-Identifier: Apache-2.0
"""`vega print`: starts both nodes in processes of their own, plans and prints with them."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from vega_planner.errors import Cancelled, DriverError, NotPrintable
from vega_planner.progress import Progress, Report
from vega_planner.settings import Settings, as_dict

#: Share of the whole job that planning takes, for the progress bar.
PLANNING_SHARE = 0.4
#: Time a node may take to end before it is killed [s].
ENDING = 10.0


def print_part(
    part: str | Path,
    settings: Settings,
    output: str | Path,
    *,
    hardware: str = "simulated",
    realtime: bool = False,
    report: Report,
) -> tuple[dict[str, Any], int]:
    """Plan a part and print it through the nodes.

    Args:
        part: Path of the mesh.
        settings: What to plan with.
        output: Result folder.
        hardware: "simulated", "emulated" or "ethercat".
        realtime: Run a simulation at the pace of the clock.
        report: Told how far it is.

    Returns:
        The plan's summary with an entry "execution", and the exit status.

    Raises:
        VegaError: What planner or driver raised.
        Cancelled: If interrupted; the machine has stopped then.
    """
    # Nodes of one machine find each other; nothing is told to the network.
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    import rclpy
    import yaml
    from rclpy.signals import SignalHandlerOptions

    from vega_msgs.action import ExecutePrint, PlanLayers
    from vega_planner.nodes.session import Session

    namespace = f"/vega_{os.getpid()}"
    with (
        TemporaryDirectory(prefix="vega_print_") as scratch,
        _nodes(
            namespace, Path(scratch), _parameters(settings, hardware, realtime, scratch)
        ) as nodes,
    ):
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        signal.signal(signal.SIGTERM, _interrupt)
        session = Session(namespace, "vega_print", nodes.check)
        try:
            goal = PlanLayers.Goal(
                mesh=str(Path(part).absolute()),
                settings=yaml.safe_dump(as_dict(settings)),
                output_folder=str(Path(output).absolute()),
            )
            plan = session.plan(goal, _part_of(report, 0.0, PLANNING_SHARE))
            summary = json.loads(plan.summary)
            if plan.status == "not":
                return summary, NotPrintable.exit_status
            session.bring_up()
            job = ExecutePrint.Goal(folder=plan.folder)
            done = session.execute(job, _part_of(report, PLANNING_SHARE, 1.0))
            summary["execution"] = _execution(done, hardware)
            return summary, 0
        except KeyboardInterrupt:
            session.cancel()
            raise Cancelled("interrupted; the machine has stopped, dispenser off") from None
        finally:
            session.close()
            rclpy.try_shutdown()


def _execution(result: Any, hardware: str) -> dict[str, Any]:
    """Collect the figures of a print, with their units in the names."""
    from vega_planner.units import m_to_mm

    return {
        "hardware": hardware,
        "passes": result.paths_done,
        "duration_s": round(result.duration, 3),
        "mean_tracking_error_mm": round(m_to_mm(result.mean_tracking_error), 6),
        "max_tracking_error_mm": round(m_to_mm(result.max_tracking_error), 6),
    }


def _part_of(report: Report, start: float, end: float) -> Report:
    def scaled(progress: Progress) -> None:
        fraction = start + (end - start) * min(max(progress.fraction, 0.0), 1.0)
        report(replace(progress, fraction=fraction))

    return scaled


def _parameters(
    settings: Settings, hardware: str, realtime: bool, scratch: str
) -> dict[str, dict[str, Any]]:
    """Collect the parameters of each node."""
    driver = {
        "hardware": hardware,
        "robot": settings.cell.robot,
        "material": settings.cell.material,
        "realtime": realtime,
        "state_folder": f"{scratch}/machine",
    }
    return {"vega_planner.nodes.planner": {}, "vega_robot_driver.nodes.robot_driver": driver}


class _Nodes:
    """The processes of the nodes."""

    def __init__(self, processes: dict[str, subprocess.Popen], logs: dict[str, Path]) -> None:
        self._processes, self._logs = processes, logs

    def check(self) -> None:
        """Tell when one has died.

        Raises:
            DriverError: With the last line it wrote.
        """
        for name, process in self._processes.items():
            status = process.poll()
            if status is not None:
                lines = self._logs[name].read_text(errors="replace").strip().splitlines()
                last = lines[-1] if lines else "it said nothing"
                raise DriverError(f"node {name} ended with status {status}: {last}")


def _end_with_parent() -> None:
    """Have the kernel interrupt this process when the one that started it dies."""
    import ctypes

    ctypes.CDLL(None).prctl(1, signal.SIGINT)  # PR_SET_PDEATHSIG


def _interrupt(*_: object) -> None:
    raise KeyboardInterrupt


@contextmanager
def _nodes(
    namespace: str, folder: Path, parameters: dict[str, dict[str, Any]]
) -> Iterator[_Nodes]:
    """Run nodes as processes; they are interrupted and awaited at the end."""
    processes: dict[str, subprocess.Popen] = {}
    logs: dict[str, Path] = {}
    try:
        for module, values in parameters.items():
            name = module.rsplit(".", 1)[-1]
            command = [sys.executable, "-m", module, "--ros-args", "-r", f"__ns:={namespace}"]
            for key, value in values.items():
                command += ["-p", f"{key}:={json.dumps(value)}"]
            logs[name] = folder / f"{name}.log"
            with logs[name].open("wb") as log:
                processes[name] = subprocess.Popen(
                    command,
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=log,
                    start_new_session=True,  # ctrl-c is handled here, goal by goal
                    preexec_fn=_end_with_parent,
                )
        yield _Nodes(processes, logs)
    finally:
        for process in processes.values():
            with contextlib.suppress(ProcessLookupError):
                process.send_signal(signal.SIGINT)
        for process in processes.values():
            try:
                process.wait(timeout=ENDING)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
