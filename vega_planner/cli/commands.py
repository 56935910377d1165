# SPDX-License-Identifier: Apache-2.0
"""What each command does. Every function returns the exit status."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from vega_planner.cli.parser import settings_changes
from vega_planner.cli.terminal import progress_bar, summary_lines
from vega_planner.errors import InvalidInput, NotPrintable
from vega_planner.settings import Settings, load_settings

#: What `slice` sets: flat layers, nozzle upright, walls and concentric infill.
BASELINE: dict[str, Any] = {
    "layers": {"engine": "planar"},
    "printability": {"orientation": "vertical"},
    "toolpaths": {"pattern": "contour", "spacing": "euclidean"},
}


def read_settings(options: argparse.Namespace) -> Settings:
    """Put the settings together: defaults, then the file, then the options."""
    settings = Settings()
    if options.settings:
        settings = load_settings(options.settings, settings)
    return settings.updated(settings_changes(options))


def plan(options: argparse.Namespace) -> int:
    """Plan a print."""
    return _plan_into(options, read_settings(options), options.output)


def slice(options: argparse.Namespace) -> int:
    """Plan the planar baseline."""
    return _plan_into(options, read_settings(options).updated(BASELINE), options.output)


def _plan_into(options: argparse.Namespace, settings: Settings, out: str) -> int:
    from vega_planner.memory import keep_freed_memory
    from vega_planner.pipeline import plan as make_plan
    from vega_planner.results.folder import check_output_folder

    check_output_folder(out)
    keep_freed_memory()
    with progress_bar(options.quiet) as report:
        result = make_plan(options.part, settings, report)
        folder = result.write(out)
    if not options.quiet:
        print("\n".join(summary_lines(result.summary, str(folder))))
    return NotPrintable.exit_status if result.printability.status == "not" else 0


def simulate(options: argparse.Namespace) -> int:
    """Print a result folder virtually."""
    from vega_planner.assess.virtual_print import simulate_folder

    with progress_bar(options.quiet) as report:
        fidelity = simulate_folder(
            options.folder,
            voxel_mm=options.voxel,
            noise_mm=options.noise,
            seed=options.seed,
            report=report,
        )
    if not options.quiet:
        print(json.dumps(fidelity, indent=2))
    return 0


def evaluate(options: argparse.Namespace) -> int:
    """Register a scan and measure it."""
    from vega_planner.assess.evaluate import evaluate as evaluate_scan

    with progress_bar(options.quiet) as report:
        metrics = evaluate_scan(
            options.scan, options.target, options.output, seed=options.seed, report=report
        )
    if not options.quiet:
        print(json.dumps(metrics, indent=2))
    return 0


def compare(options: argparse.Namespace) -> int:
    """Plan, slice, simulate both and report."""
    from vega_planner.assess.compare import compare_folders
    from vega_planner.assess.virtual_print import check_voxel, simulate_folder
    from vega_planner.pipeline import plan as make_plan
    from vega_planner.progress import within
    from vega_planner.results.folder import staged_folder

    settings = read_settings(options)
    check_voxel(options.voxel)
    status = 0
    with progress_bar(options.quiet) as report, staged_folder(options.output) as folder:
        for start, name, changes in ((0.0, "plan", {}), (0.5, "slice", BASELINE)):
            tell = within(report, name, start, start + 0.25)
            result = make_plan(options.part, settings.updated(changes), tell)
            if not result.toolpaths.passes:
                raise NotPrintable(
                    f"nothing of '{result.part.name}' can be printed by 'vega {name}', "
                    "so there is nothing to compare; 'vega plan' says why"
                )
            if name == "plan" and result.printability.status == "not":
                status = NotPrintable.exit_status
            result.write(folder / name)
            tell = within(report, f"simulate {name}", start + 0.25, start + 0.5)
            simulate_folder(folder / name, voxel_mm=options.voxel, report=tell)
        table = compare_folders(folder / "plan", folder / "slice", folder)
    if not options.quiet:
        print(json.dumps(table, indent=2))
        print(f"report: {Path(options.output).absolute() / 'report.html'}")
    return status


def print_(options: argparse.Namespace) -> int:
    """Plan and print through the ROS 2 nodes."""
    from vega_planner.nodes.print_client import print_part
    from vega_planner.results.folder import check_output_folder

    check_output_folder(options.output)
    settings = read_settings(options)
    with progress_bar(options.quiet) as report:
        summary, status = print_part(
            options.part,
            settings,
            options.output,
            hardware=options.hardware,
            realtime=options.realtime,
            report=report,
        )
    if not options.quiet:
        print("\n".join(summary_lines(summary, str(Path(options.output).absolute()))))
    return status


def substrate(options: argparse.Namespace) -> int:
    """Write the conformal substrate of a part."""
    from vega_planner.part import load_part
    from vega_planner.results.substrate_file import write_substrate

    settings = read_settings(options)
    with progress_bar(options.quiet) as report:
        part = load_part(options.part, settings.part)
        path = write_substrate(part, options.output, options.clearance, settings, report)
    if not options.quiet:
        print(path)
    return 0


def view(options: argparse.Namespace) -> int:
    """Show a part or a result folder in the browser."""
    from vega_planner.viewer.server import serve

    if not 0 <= options.port <= 65535:
        raise InvalidInput(f"port {options.port}; allowed: 0 to 65535")
    serve(options.target, host=options.host, port=options.port, browser=not options.no_browser)
    return 0


def export(options: argparse.Namespace) -> int:
    """Write a plan for a machine's controller."""
    from vega_planner.export import export_plan

    print(export_plan(options.folder, options.format, options.output, options.robot))
    return 0


COMMANDS = {
    "plan": plan,
    "slice": slice,
    "simulate": simulate,
    "evaluate": evaluate,
    "compare": compare,
    "print": print_,
    "substrate": substrate,
    "view": view,
    "export": export,
}
