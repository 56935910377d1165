# SPDX-License-Identifier: Apache-2.0
"""Toolpaths on domes, a wavy layer and nested shells: quality first, then time.

Run: python bench/toolpaths.py [--json FILE]
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from vega_planner.datatypes import ToolpathSet
from vega_planner.settings import ToolpathSettings
from vega_planner.toolpaths import lay_toolpaths
from vega_planner.toolpaths.bead import fill_spacing
from vega_planner.toolpaths.coverage import (
    deposited_volume,
    pass_gaps,
    uncovered_area,
    volume_to_fill,
)
from vega_planner.toolpaths.lay import patch_passes
from vega_planner.toolpaths.rim import ground_of


def shapes():
    """Load the shapes that the tests draw."""
    path = Path(__file__).parents[1] / "test" / "toolpaths" / "conftest.py"
    spec = importlib.util.spec_from_file_location("toolpath_shapes", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.make.__wrapped__() if hasattr(module.make, "__wrapped__") else module.make


def quality(patches, done: ToolpathSet) -> dict:
    spacing = fill_spacing(1.2, 0.8)
    gaps, lengths, bare = [], [], 0.0
    for n, patch in enumerate(patches):
        mine = [path for path in done.passes if path.patch == n]
        gap, length = pass_gaps(mine, spacing)
        gaps.append(gap)
        lengths.append(length)
        bare += uncovered_area(patch, mine, 0.55 * spacing, 0.2)
    gap, length = np.concatenate(gaps), np.concatenate(lengths)
    order = np.argsort(gap)
    sums = np.cumsum(length[order])
    fill = sum(volume_to_fill(patch) for patch in patches)
    return {
        "gap_mean": float((gap * length).sum() / length.sum()),
        "gap_p99": float(gap[order][np.searchsorted(sums, 0.99 * sums[-1])]),
        "gap_max": float(gap.max()),
        "gap_over_1.1_ratio": float(length[gap > 1.1].sum() / length.sum()),
        "uncovered_pct": 100 * bare / sum(patch.area for patch in patches),
        "volume_ratio": deposited_volume(done.passes) / fill,
        "passes": len(done.passes),
        "length_mm": done.path_length_mm,
        "travel_pct": 100 * done.travel_length_mm / done.path_length_mm,
        "points": sum(len(path.points) for path in done.passes),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    make = shapes()
    cases = {f"dome {d:g}": (make.dome(30.0, d),) for d in (45.0, 60.0, 70.0)}
    cases["wavy"] = (make.wavy(),)
    cases["wavy disc"] = (make.wavy_disc(),)
    turn = np.linspace(0.0, 2 * np.pi, 200, endpoint=False)
    disc = 20.0 * np.column_stack([np.cos(turn), np.sin(turn)])
    cases["flat disc"] = (make.flat([disc]),)
    cases["18 shells"] = make.nest(26.0, 18, 7000)
    table = {}
    missed: list[str] = []
    for name, patches in cases.items():
        stack, cell = make.stack(patches), make.cell()
        targets = name != "18 shells"
        for pattern, spacing, angle in (
            ("contour", "geodesic", 0.0),
            ("zigzag", "geodesic", 0.0),
            *((("zigzag", "geodesic", turn) for turn in (30.0, 45.0, 90.0)) if targets else ()),
            ("spiral", "geodesic", 0.0),
            ("contour", "euclidean", 0.0),
            ("zigzag", "euclidean", 0.0),
        ):
            settings = replace(
                ToolpathSettings(),
                pattern=pattern,
                spacing=spacing,
                angle_deg=angle,
                skin_overlap_ratio=0.0,
            )
            done = lay_toolpaths(patches, stack, cell, settings)
            row = quality(patches, done)
            wall, cpu = time.perf_counter(), time.process_time()
            lay_toolpaths(patches, stack, cell, settings)
            row["wall_s"] = time.perf_counter() - wall
            row["cpu_s"] = time.process_time() - cpu
            ground = ground_of(0.0, None)
            cpu = time.thread_time()
            for n, patch in enumerate(patches):
                patch_passes(patch, n, False, settings, ground)
            row["one_thread_s"] = time.thread_time() - cpu
            turned = f" {angle:g}" if angle else ""
            table[f"{name}, {pattern}{turned}, {spacing}"] = row
            if targets and spacing == "geodesic":
                wanted = (("gap_p99", 1.02), ("gap_max", 1.1), ("uncovered_pct", 0.5))
                missed += [
                    f"{name}, {pattern}{turned}: {key} {row[key]:.3f}, wanted {most:g}"
                    for key, most in wanted
                    if row[key] > most
                ]
            print(
                f"{name:10s} {pattern + turned:10s}{spacing:10s} gap p99 {row['gap_p99']:.3f}"
                f" max {row['gap_max']:.3f} over 1.1 {100 * row['gap_over_1.1_ratio']:.2f} %"
                f" bare {row['uncovered_pct']:.2f} % volume {row['volume_ratio']:.4f}"
                f" passes {row['passes']:3d} travel {row['travel_pct']:.1f} %"
                f" points {row['points']:6d} {1000 * row['one_thread_s']:.0f} ms one thread,"
                f" {1000 * row['wall_s']:.0f} ms wall"
            )
    print("missed: " + ("; ".join(missed) or "nothing"))
    if options.json:
        options.json.write_text(json.dumps(table, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
