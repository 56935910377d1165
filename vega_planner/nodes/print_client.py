# SPDX-License-Identifier: Apache-2.0
"""`vega print`: starts both nodes in processes of their own, plans and prints with them."""

from __future__ import annotations

import json
import os
import signal
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from vega_planner.errors import Cancelled, NotPrintable
from vega_planner.nodes.node_processes import run_nodes
from vega_planner.progress import Progress, Report
from vega_planner.settings import Settings, as_dict

#: Share of the whole job that planning takes, for the progress bar.
PLANNING_SHARE = 0.4


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
        run_nodes(
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


def _interrupt(*_: object) -> None:
    raise KeyboardInterrupt
