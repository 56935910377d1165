# SPDX-License-Identifier: Apache-2.0
"""Texts of the panel."""

from __future__ import annotations

from typing import Any

from vega_planner.viewer.job import JobState
from vega_planner.viewer.timeline import Moment


def clock(seconds: float) -> str:
    """Print a time as h:mm:ss, or m:ss below an hour."""
    whole = int(max(seconds, 0.0))
    hours, minutes, rest = whole // 3600, whole // 60 % 60, whole % 60
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


def status_text(name: str, planning: bool, state: JobState, remark: str, people: int) -> str:
    """Say what goes on: file, state of the print, time left, who else looks."""
    lines = [f"**{name}**"]
    if planning:
        lines.append(remark or "planning")
    else:
        if state.state not in ("idle", "off") or state.detail:
            left = f", {clock(state.time_left_s)} left" if state.state == "printing" else ""
            share = f" {100 * state.progress:.0f} %" if state.progress else ""
            detail = f" ({state.detail})" if state.detail else ""
            lines.append(f"{state.state}{share}{left}{detail}")
        if remark:
            lines.append(remark)
    if people > 1:
        lines.append(f"{people} viewers are connected; all share this view and its buttons.")
    return "  \n".join(lines)


def moment_text(
    moment: Moment, time_s: float, duration_s: float, dispensing: bool, state: JobState | None
) -> str:
    """Say where the print stands: time, layer, pass, dispenser, tip."""
    where = f"pass {moment.path}" if moment.path >= 0 else "travel"
    lines = [
        f"{clock(time_s)} of {clock(duration_s)} · layer {moment.layer} · {where}",
        f"dispenser **{'on' if dispensing else 'off'}** · tip "
        + ", ".join(f"{round(value, 1) + 0.0:.1f}" for value in moment.tip)
        + " mm",
    ]
    if state is not None:
        lines.append(
            f"pressure {state.pressure_pa / 1e5:.2f} bar · tracking error "
            f"{state.tracking_error_m * 1e6:.0f} µm"
        )
    return "  \n".join(lines)


def result_text(summary: dict[str, Any]) -> str:
    """Put a plan's summary into a table and its warnings below."""
    cover = summary.get("coverage", {})
    printable = summary.get("printability", {})
    rows = [
        ("printable", printable.get("status", "unknown")),
        ("layers", _layers(summary)),
        ("engine", summary.get("engine", "")),
        ("volume", _number(summary.get("volume_mm3"), 1e-3, "cm³", 2)),
        ("print time", clock(float(summary.get("print_time_s", 0.0)))),
        ("path", _number(summary.get("path_length_mm"), 1e-3, "m", 2)),
        ("travel", _number(summary.get("travel_length_mm"), 1e-3, "m", 2)),
        ("material", _number(summary.get("material_mm3"), 1e-3, "cm³", 2)),
        ("not covered", _number(cover.get("under_ratio"), 100, "%", 2)),
        ("covered twice", _number(cover.get("over_ratio"), 100, "%", 2)),
        ("reachable", _number(printable.get("reachable_ratio"), 100, "%", 1)),
        ("accessible", _number(printable.get("accessible_ratio"), 100, "%", 1)),
        ("free of collisions", _number(printable.get("collision_free_ratio"), 100, "%", 1)),
    ]
    lines = ["| | |", "| --- | --- |", *(f"| {name} | {value} |" for name, value in rows if value)]
    reasons = [
        f"- **{reason.get('code')}**: {reason.get('area_mm2', 0):.0f} mm²"
        f"{_on_layer(reason)}. {reason.get('remedy', '')}"
        for reason in printable.get("reasons", [])[:8]
    ]
    warnings = [f"- {text}" for text in summary.get("warnings", [])[:8]]
    if reasons:
        lines += ["", "**What stands against printing**", "", *reasons]
    if warnings:
        lines += ["", "**Warnings**", "", *warnings]
    return "\n".join(lines)


def _layers(summary: dict[str, Any]) -> str:
    cores = len(summary.get("cores", []))
    more = f" + {cores} core" if cores else ""
    return f"{summary.get('layers', '?')}{more} of {summary.get('layer_thickness_mm', '?')} mm"


def _on_layer(reason: dict[str, Any]) -> str:
    layer = reason.get("layer", -1)
    return f" on layer {layer}" if layer >= 0 else ""


def _number(value: float | None, factor: float, unit: str, digits: int) -> str:
    return "" if value is None else f"{factor * value:.{digits}f} {unit}"
