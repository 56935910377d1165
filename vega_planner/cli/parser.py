# SPDX-License-Identifier: Apache-2.0
"""Commands and options of `vega`. Imports nothing heavy, so that help comes at once."""

from __future__ import annotations

import argparse
from typing import Any, NoReturn

from vega_planner import __version__
from vega_planner.settings import (
    CellSettings,
    LayerSettings,
    PrintabilitySettings,
    ToolpathSettings,
    TrajectorySettings,
)

#: Option, section and field it sets, type, metavar, help.
_PLAN_OPTIONS: tuple[tuple[str, str, type, Any], ...] = (
    ("--thickness", "layers.thickness_mm", float, LayerSettings),
    ("--width", "toolpaths.width_mm", float, ToolpathSettings),
    ("--speed", "trajectory.speed_mm_s", float, TrajectorySettings),
    ("--engine", "layers.engine", str, LayerSettings),
    ("--pattern", "toolpaths.pattern", str, ToolpathSettings),
    ("--angle", "toolpaths.angle_deg", float, ToolpathSettings),
    ("--spacing", "toolpaths.spacing", str, ToolpathSettings),
    ("--orientation", "printability.orientation", str, PrintabilitySettings),
    ("--robot", "cell.robot", str, CellSettings),
    ("--tool", "cell.tool", str, CellSettings),
    ("--material", "cell.material", str, CellSettings),
    ("--pose", "cell.pose", str, CellSettings),
)


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message}; '{self.prog} --help' lists the options\n")


def make_parser() -> argparse.ArgumentParser:
    """Build the parser of all commands."""
    parser = _Parser(
        prog="vega",
        description="From a mesh to checked robot motion, in enveloping layers.",
    )
    parser.add_argument("--version", action="version", version=f"vega {__version__}")
    commands = parser.add_subparsers(
        dest="command", required=True, metavar="COMMAND", parser_class=_Parser
    )
    _add_planning(commands, "plan", "mesh -> layers -> toolpaths -> joint trajectory")
    _add_planning(commands, "slice", "planar baseline, same parameters and outputs")
    _add_simulate(commands)
    _add_evaluate(commands)
    compare = _add_planning(commands, "compare", "plan, slice, simulate both; one report")
    compare.add_argument("--voxel", type=float, default=0.1, metavar="MM")
    _add_print(commands)
    _add_substrate(commands)
    _add_view(commands)
    _add_export(commands)
    return parser


def _add_planning(commands: Any, name: str, text: str) -> argparse.ArgumentParser:
    command = commands.add_parser(name, help=text, description=text)
    command.add_argument("part", metavar="PART", help="mesh file")
    command.add_argument("-o", "--output", required=True, metavar="OUT", help="result folder")
    add_settings(command)
    return command


def add_settings(command: argparse.ArgumentParser) -> None:
    """Add the options that all planning commands share."""
    command.add_argument(
        "--brr",
        action="append",
        metavar="SPEC",
        help="restraint region, repeatable (union): none | auto | down | "
        "normal:X,Y,Z[:DEG] | point:X,Y,Z | faces:FILE | not:SPEC",
    )
    for flag, path, kind, section in _PLAN_OPTIONS:
        item = section.__dataclass_fields__[path.split(".")[1]]
        choices = item.metadata["choices"] or None
        command.add_argument(
            flag,
            dest=path,
            type=kind,
            choices=choices,
            default=None,
            metavar=None if choices else ("VALUE" if kind is str else "N"),
            help=f"{item.metadata['doc'].replace('%', '%%')} Default: {item.default}.",
        )
    command.add_argument("--settings", metavar="YAML", help="settings file")
    command.add_argument(
        "--compensate", metavar="REPORT_DIR", help="evaluation whose deviation moves the target"
    )
    command.add_argument("--seed", type=int, metavar="N", help="seed of everything random")
    command.add_argument("-q", "--quiet", action="store_true", help="print nothing but errors")


def settings_changes(options: argparse.Namespace) -> dict[str, Any]:
    """Collect what the command line sets, nested like the settings."""
    changes: dict[str, Any] = {}
    for _, path, _, _ in _PLAN_OPTIONS:
        value = getattr(options, path)
        if value is not None:
            section, key = path.split(".")
            changes.setdefault(section, {})[key] = value
    if options.brr:
        changes.setdefault("part", {})["brr"] = tuple(options.brr)
    if options.seed is not None:
        changes["seed"] = options.seed
    if options.compensate:
        changes["compensate"] = options.compensate
    return changes


def _add_simulate(commands: Any) -> None:
    text = "virtual print of a result folder"
    command = commands.add_parser("simulate", help=text, description=text)
    command.add_argument("folder", metavar="OUT", help="result folder of plan or slice")
    command.add_argument("--voxel", type=float, default=0.1, metavar="MM", help="default 0.1")
    command.add_argument("--noise", type=float, default=0.0, metavar="MM", help="scanner noise")
    command.add_argument("--seed", type=int, default=0, metavar="N")
    command.add_argument("-q", "--quiet", action="store_true")


def _add_evaluate(commands: Any) -> None:
    text = "register a scan to its target and measure the print"
    command = commands.add_parser("evaluate", help=text, description=text)
    command.add_argument("scan", metavar="SCAN", help="scanned mesh or point cloud")
    command.add_argument("target", metavar="TARGET", help="mesh the print is to match")
    command.add_argument("-o", "--output", required=True, metavar="REPORT_DIR")
    command.add_argument("--seed", type=int, default=0, metavar="N")
    command.add_argument("-q", "--quiet", action="store_true")


def _add_print(commands: Any) -> None:
    command = _add_planning(commands, "print", "plan, then print through the ROS 2 nodes")
    command.add_argument(
        "--hardware", choices=("simulated", "emulated", "ethercat"), default="simulated"
    )
    command.add_argument(
        "--realtime", action="store_true", help="simulate at the speed of the real machine"
    )


def _add_substrate(commands: Any) -> None:
    text = "conformal substrate for a part with a non-planar base"
    command = commands.add_parser("substrate", help=text, description=text)
    command.add_argument("part", metavar="PART")
    command.add_argument("-o", "--output", required=True, metavar="STL")
    command.add_argument("--clearance", type=float, default=None, metavar="MM")
    add_settings(command)


def _add_view(commands: Any) -> None:
    text = "browser viewer"
    command = commands.add_parser("view", help=text, description=text)
    command.add_argument("target", metavar="OUT|PART", help="result folder or mesh file")
    command.add_argument("--port", type=int, default=8080, metavar="N")
    command.add_argument("--host", default="127.0.0.1", metavar="ADDRESS")
    command.add_argument("--no-browser", action="store_true")


def _add_export(commands: Any) -> None:
    text = "write a plan for a machine's controller"
    command = commands.add_parser("export", help=text, description=text)
    command.add_argument("folder", metavar="OUT", help="result folder")
    command.add_argument("--format", choices=("gcode", "urscript", "csv"), required=True)
    command.add_argument(
        "--robot",
        metavar="URDF",
        default=None,
        help="the robot the result was planned for, where it is not one of config/robots",
    )
    command.add_argument("-o", "--output", metavar="FILE", default=None)
