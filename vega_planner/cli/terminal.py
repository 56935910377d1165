# SPDX-License-Identifier: Apache-2.0
"""What a person sees while a job runs, and the one-screen summary at its end."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from vega_planner.progress import Progress, Report, silent


@contextmanager
def progress_bar(quiet: bool = False) -> Iterator[Report]:
    """Show a progress bar on a terminal, and nothing in a log.

    Args:
        quiet: Show nothing in any case.

    Yields:
        The report to hand to the job.
    """
    if quiet or not sys.stderr.isatty():
        yield silent
        return
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar

    columns = (TextColumn("{task.description:<14}"), BarColumn(40), TimeElapsedColumn())
    with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=1.0)

        def show(progress: Progress) -> None:
            text = f"{progress.stage} {progress.detail}".strip()
            bar.update(task, completed=progress.fraction, description=text)

        yield show


def summary_lines(summary: dict[str, Any], folder: str) -> list[str]:
    """Put a plan's summary on one screen.

    Args:
        summary: As in `summary.json`.
        folder: Where the results are.
    """
    print_state = summary["printability"]
    cover = summary["coverage"]
    cores = f" + {len(summary['cores'])} core" if summary.get("cores") else ""
    rows = [
        ("part", f"{summary['mesh']}, {summary['volume_mm3'] / 1000:.2f} cm³"),
        (
            "restraint",
            f"{' '.join(summary['brr']['spec'])} ({summary['brr']['faces']} faces, "
            f"{summary['brr']['area_mm2']:.0f} mm²)",
        ),
        (
            "layers",
            f"{summary['layers']}{cores}, {summary['engine']}, "
            f"t = {summary['layer_thickness_mm']:g} mm",
        ),
        (
            "printable",
            f"{print_state['status']}, {print_state['split_layers']} layers split, "
            f"{summary['collisions']['colliding_waypoints']} colliding waypoints",
        ),
        (
            "path",
            f"{summary['path_length_mm'] / 1000:.2f} m in {summary['passes']} passes, "
            f"{summary['travel_length_mm'] / 1000:.2f} m travel",
        ),
        ("print time", duration(summary["print_time_s"])),
        (
            "material",
            f"{summary['material_mm3'] / 1000:.2f} cm³ (under "
            f"{cover['under_ratio']:.1%}, over {cover['over_ratio']:.1%})",
        ),
        ("computed in", f"{summary['total_s']:.2f} s, {summary['peak_memory_mb']:.0f} MB"),
    ]
    label = "mind" if print_state["status"] == "fully" else "why not"
    for reason in print_state["reasons"][:5]:
        area = f"{reason['area_mm2']:.0f} mm²; " if reason["area_mm2"] else ""
        rows.append((label, f"{reason['code']}: {area}{reason['remedy']}"))
    rows.extend(("note", text) for text in summary["warnings"][:6])
    rows.append(("results", folder))
    return [f"{name:>12}  {text}" for name, text in rows]


def duration(seconds: float) -> str:
    """Say a time for a person: `1 h 03 min`, `4 min 20 s` or `7.5 s`."""
    if seconds >= 3600:
        return f"{int(seconds // 3600)} h {int(seconds % 3600 // 60):02d} min"
    if seconds >= 60:
        return f"{int(seconds // 60)} min {int(seconds % 60):02d} s"
    return f"{seconds:.1f} s"
