# SPDX-License-Identifier: Apache-2.0
"""Node `print_job`: plans and prints one mesh with the running nodes, then ends.

Parameters: `mesh` (path or file URI), `brr` (SPECs, separated by semicolons), `settings`
(path of a settings file), `output` (result folder), `print` (false only plans), `resume`.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import rclpy
from rclpy.logging import get_logger
from rclpy.utilities import remove_ros_args

from vega_msgs.action import ExecutePrint, PlanLayers
from vega_planner.errors import InvalidInput, NotPrintable, VegaError
from vega_planner.nodes.session import Session
from vega_planner.nodes.worker import mesh_path
from vega_planner.progress import Progress

_DEFAULTS: dict[str, Any] = {
    "mesh": "",
    "brr": "",
    "settings": "",
    "output": "",
    "robot": "",
    "print": True,
    "resume": False,
}


class _Log:
    """Says how far a job is: a line for each stage and each tenth."""

    def __init__(self) -> None:
        self._last = ("", -1)

    def __call__(self, progress: Progress) -> None:
        step = (progress.stage, int(progress.fraction * 10))
        if step != self._last:
            self._last = step
            text = f"{progress.stage} {progress.fraction:4.0%} {progress.detail}".rstrip()
            get_logger("print_job").info(text)


def main() -> int:
    """Run one job; the exit status is the command line's."""
    rclpy.init()
    remove_ros_args(sys.argv)
    session = Session()
    try:
        return _run(session)
    except VegaError as error:
        session.node.get_logger().error(str(error))
        return error.exit_status
    except KeyboardInterrupt:
        session.cancel()
        return 4
    finally:
        session.close()
        rclpy.try_shutdown()


def _run(session: Session) -> int:
    values = {
        name: session.node.declare_parameter(name, default).value
        for name, default in _DEFAULTS.items()
    }
    log = session.node.get_logger()
    if not values["mesh"]:
        raise InvalidInput("parameter 'mesh' is empty; give the path of a mesh")
    mesh = Path(mesh_path(str(values["mesh"]))).expanduser().absolute()
    output = values["output"] or str(Path.cwd() / "out" / mesh.stem)
    goal = PlanLayers.Goal(
        mesh=str(mesh),
        brr=[spec.strip() for spec in str(values["brr"]).split(";") if spec.strip()],
        settings=_settings_text(str(values["settings"]), str(values["robot"])),
        output_folder=str(Path(output).expanduser().absolute()),
    )
    plan = session.plan(goal, _Log())
    log.info(
        f"planned: {plan.layer_count} layers, {plan.path_count} passes, "
        f"{plan.duration:.0f} s, {plan.status} printable; {plan.folder}"
    )
    if plan.status == "not":
        return NotPrintable.exit_status
    if not values["print"]:
        return 0
    session.wait_until_active()
    job = ExecutePrint.Goal(folder=plan.folder, resume=bool(values["resume"]))
    done = session.execute(job, _Log())
    log.info(
        f"printed {done.paths_done} passes in {done.duration:.0f} s of the machine's time, "
        f"mean tracking error {done.mean_tracking_error * 1e6:.1f} µm"
    )
    return 0


def _settings_text(path: str, robot: str) -> str:
    """Read a settings file and put the robot's name over it."""
    import yaml

    from vega_planner.settings import as_dict, load_settings

    if not path and not robot:
        return ""
    from vega_planner.settings import Settings

    settings = load_settings(Path(path).expanduser()) if path else Settings()
    if robot:
        settings = settings.updated({"cell": {"robot": robot}})
    return yaml.safe_dump(as_dict(settings))


if __name__ == "__main__":
    raise SystemExit(main())
