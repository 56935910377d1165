# SPDX-License-Identifier: Apache-2.0
"""The tables of the driver's benchmark, as they are printed and as docs/results shows them."""

from __future__ import annotations

from typing import Any

#: Title and cells of each column of the faults.
_COLUMNS = (
    ("what happens", lambda name, row: name),
    ("standstill [ms]", lambda name, row: _time(row["standstill_ms"])),
    ("valve closed [ms]", lambda name, row: _time(row["valve_closed_ms"])),
    ("open at standstill [cycles]", lambda name, row: str(row["on_at_standstill"])),
    ("ends as", lambda name, row: row["state"] + ("" if row["safe"] else " (wrong)")),
    ("runs", lambda name, row: str(row.get("runs", 1))),
    ("computer late by [ms]", lambda name, row: _late(row)),
)


def _time(value: float | None) -> str:
    return "goes on" if value is None else f"{value:.0f}"


def _late(row: dict[str, Any]) -> str:
    return f"{row['computer_late_ms']:.0f}" if "computer_late_ms" in row else "by frames"


def _markdown(rows: list[list[str]]) -> str:
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    lines = [
        "| "
        + " | ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True))
        + " |"
        for row in rows
    ]
    lines.insert(1, "| " + " | ".join("-" * width for width in widths) + " |")
    return "\n".join(lines)


def table(rows: dict[str, dict[str, Any]]) -> str:
    """What happens in each fault."""
    cells = [[cell(name, row) for _, cell in _COLUMNS] for name, row in rows.items()]
    return _markdown([[title for title, _ in _COLUMNS], *cells])


def figures(found: dict[str, tuple[Any, str, bool]]) -> str:
    """Figures beside their targets."""
    cells = [
        [name, str(value), target, ("met" if met else "MISSED") if target else ""]
        for name, (value, target, met) in found.items()
    ]
    return _markdown([["figure", "found", "target", ""], *cells])


def written(
    rows: dict[str, dict[str, Any]], found: dict[str, tuple[Any, str, bool]], more: dict[str, Any]
) -> str:
    """The page of docs/results."""
    kills, load = (
        more["interruptions"],
        ", ".join(f"{value:.1f}" for value in more["load_average"]),
    )
    kinds = ", ".join(f"{name.replace('_', ' ')} {n}" for name, n in kills["by_kind"].items())
    return f"""# The driver on emulated drives

Written by `bench/driver.py -o docs/results`, on {more["cores"]} cores with a load of
{load} (1, 5 and 15 minutes).
**These are an emulation's figures, not a machine's**: the drives' dynamics are invented, and
nothing here has run on hardware. They say that the driver does what it is meant to; what a
machine does, commissioning has to measure.

{figures(found)}

Start counts from nothing to five drives in operation, the processes included: the fastest of
{more["start_runs"]} runs; the slowest took {more["start_s"]["slowest"]:g} s. Without root:
{more["unprivileged"]}.

Interruptions of prints, on drives whose time is the frames':
{kinds};
{kills["beads"]} beads, longest gap {kills["longest_gap_mm"]:g} mm, longest overlap
{kills["longest_overlap_mm"]:g} mm.

## What happens to a bead

In the middle of a straight bead at 5 mm/s, with a ramp of 100 ms. Of some runs, the slowest
counts.

{table(rows)}

- Times are the machine's: cycles of 2 ms, by what came back from the drives. "By frames" runs in
  one process and comes out the same on any computer. The others have all processes of a print, at
  the pace of the clock; by how much the computer was late in that time is told beside, and is
  no fault: emulated drives wait for a late cycle. What a late cycle does to real drives is
  the frozen master's row, whose drives count missed cycles and stop by themselves.
- "Open at standstill" are steps in which the drives saw the valve open after no axis had moved
  for 20 ms.
- A pause lays the bead until standstill; a stop and every fault close the valve at once.
- A dead serial line is noticed by the next reading and its repetitions. Until then the print goes
  on as it should: the valve is wired, and closes in the cycle after.
- The answer to a reading may be asked for again. A shot's start must not: where the line
  starts shots, the shot ends by itself after its time, here 0.1 s, and only the output that cuts
  the air is faster. Without such an output material flows at standstill until then.
"""
