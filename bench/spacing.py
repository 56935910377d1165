# SPDX-License-Identifier: Apache-2.0
"""The six parts with geodesic and with Euclidean spacing: volume, travel, undershoot, time.

Run: python bench/spacing.py [PART.stl ...] [--voxel MM] [--json FILE]

Euclidean are the paper's projected zigzag lines; zigzag, the same pattern spaced on the
surface; contour, what `vega plan` does. Undershoot is that of a virtual print, on surfaces
that are not restrained. The last columns prove the plan: deposited over the part's volume,
passes, travel over printed length, moves without a clear hop, colliding waypoints.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
from fidelity import figures_of, settings_of

from vega_planner.pipeline import plan

ROOT = Path(__file__).resolve().parent.parent
MODES: dict[str, dict[str, str]] = {
    "Euclidean": {"pattern": "zigzag", "spacing": "euclidean"},
    "zigzag": {"pattern": "zigzag", "spacing": "geodesic"},
    "contour": {},
}


def measure(path: Path, changes: dict[str, str], voxel_mm: float) -> dict[str, Any]:
    settings = settings_of(path)
    cpu = time.process_time()
    result = plan(path, settings.updated({"toolpaths": changes}))
    cpu = time.process_time() - cpu
    printed = figures_of(result, voxel_mm)
    paths = result.toolpaths
    return {
        "under_pct": printed["free"]["under_pct"],
        "over_pct": printed["free"]["over_pct"],
        "path_length_mm": paths.path_length_mm,
        "print_time_s": result.trajectory.duration_s,
        "deposited_ratio": result.coverage.deposited_mm3 / result.part.volume,
        "passes": len(paths.passes),
        "travel_pct": 100 * paths.travel_length_mm / paths.path_length_mm,
        "blocked": sum("no clear hop" in text for text in paths.warnings),
        "colliding": result.collisions["colliding_waypoints"],
        "plan_cpu_s": cpu,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", type=Path)
    parser.add_argument("--voxel", type=float, default=0.2, metavar="MM")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    table: dict[str, dict[str, dict[str, Any]]] = {}
    print(
        f"{'part':18s}{'spacing':11s}{'under %':>8s}{'over %':>8s}{'length m':>9s}{'time min':>9s}"
        f"{'volume':>8s}{'passes':>7s}{'travel %':>9s}{'blocked':>8s}{'colliding':>10s}"
    )
    for path in options.parts or sorted((ROOT / "parts").glob("part*.stl")):
        for mode, changes in MODES.items():
            row = measure(path, changes, options.voxel)
            table.setdefault(path.stem, {})[mode] = row
            print(
                f"{path.stem:18s}{mode:11s}{row['under_pct']:8.3f}{row['over_pct']:8.3f}"
                f"{row['path_length_mm'] / 1000:9.2f}{row['print_time_s'] / 60:9.1f}"
                f"{row['deposited_ratio']:8.4f}{row['passes']:7d}{row['travel_pct']:9.2f}"
                f"{row['blocked']:8d}{row['colliding']:10d}",
                flush=True,
            )
    for mode in MODES:
        rows = [modes[mode] for modes in table.values()]
        means = [
            np.mean([row[key] for row in rows])
            for key in ("under_pct", "over_pct", "path_length_mm", "print_time_s")
        ]
        print(
            f"{'mean':18s}{mode:11s}{means[0]:8.3f}{means[1]:8.3f}{means[2] / 1000:9.2f}"
            f"{means[3] / 60:9.1f}"
        )
    if options.json:
        options.json.write_text(json.dumps(table, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
