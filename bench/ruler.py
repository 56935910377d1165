# SPDX-License-Identifier: Apache-2.0
"""The ruler itself: what a virtual print costs, and how true its figures are.

    .venv/bin/python bench/ruler.py

Prints the time and memory of a virtual print of a 40 mm part at 0.1 mm; how e1 of a
16 mm dome's plan changes with half the voxel; and how well noisy half scans of a part
are found in ten random poses.
"""

from __future__ import annotations

import os
import resource
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from vega_planner.assess.evaluate import Scan
from vega_planner.assess.registration import register
from vega_planner.assess.virtual_print import VirtualPrint, simulate
from vega_planner.datatypes import Part
from vega_planner.errors import NotRegistered
from vega_planner.part import load_part
from vega_planner.pipeline import PrintPlan, plan
from vega_planner.settings import Settings, load_settings

ROOT = Path(__file__).resolve().parent.parent
DOME = ROOT / "parts" / "part1_dome.stl"
LUMPY = ROOT / "parts" / "part2_clover.stl"
PLANAR = {
    "layers": {"engine": "planar"},
    "printability": {"orientation": "vertical"},
    "toolpaths": {"spacing": "euclidean"},
}


def printed(made: PrintPlan, voxel_mm: float) -> VirtualPrint:
    """Print a plan virtually."""
    low = made.cell.placement.plate_z_mm
    return simulate(
        made.toolpaths, made.part, voxel_mm=voxel_mm, plate_z_mm=low, substrate=made.cell.substrate
    )


def cost() -> None:
    """Print a 40 mm part at 0.1 mm."""
    made = plan(DOME, load_settings(DOME.with_suffix(".yaml"), Settings()))
    printed(made, 0.4)  # loads the kernels
    wall, cpu = time.perf_counter(), time.process_time()
    printed(made, 0.1)
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    size = " x ".join(f"{side:.0f}" for side in np.ptp(made.part.bounds, axis=0))
    print(
        f"virtual print of {DOME.stem} ({size} mm) at 0.1 mm: {wall:.1f} s, "
        f"{cpu:.1f} s of processor; the process {peak:.0f} MB"
    )


def refinement() -> None:
    """Halve the voxels for a dome of 16 mm, planar and enveloping."""
    import trimesh

    settings = load_settings(DOME.with_suffix(".yaml"), Settings())
    with tempfile.TemporaryDirectory() as folder:
        mesh = trimesh.load(DOME, force="mesh", process=False)
        mesh.apply_scale(16.0 / mesh.extents.max())
        small = Path(folder) / "dome.stl"
        mesh.export(small)
        for name, changes in (("planar", PLANAR), ("enveloping", {})):
            made = plan(small, settings.updated(changes))
            coarse, fine = (printed(made, voxel).free.e1_pct for voxel in (0.1, 0.05))
            print(
                f"e1 of a 16 mm dome, {name}: {coarse:.4f} % at 0.1 mm, {fine:.4f} % at 0.05 mm: "
                f"half the voxel moves it by {100 * abs(fine / coarse - 1):.2f} % of itself"
            )


def half_scan(part: Part, generator: np.random.Generator) -> tuple[Scan, np.ndarray]:
    """See half of a part from a random side, with noise, in a random pose."""
    way = generator.normal(size=3)
    centres = part.vertices[part.faces].mean(1)
    seen = Scan(part.vertices, part.faces).part_of((centres - centres.mean(0)) @ way > 0)
    pose = np.eye(4)
    turn = np.linalg.qr(generator.normal(size=(3, 3)))[0]
    shift = generator.normal(size=3)
    pose[:3, :3] = turn * np.sign(np.linalg.det(turn))
    pose[:3, 3] = 30 * shift / np.linalg.norm(shift)
    noisy = seen.vertices + generator.normal(0, 0.03, seen.vertices.shape)
    return Scan(noisy @ pose[:3, :3].T + pose[:3, 3], seen.faces), pose


def registration() -> None:
    """Find ten noisy half scans in any rotation, 30 mm away."""
    part = load_part(LUMPY, load_settings(LUMPY.with_suffix(".yaml"), Settings()).part)
    generator = np.random.default_rng(7)
    middle = part.vertices.mean(0)
    shifts, angles, refused = [], [], 0
    began = time.perf_counter()
    for _ in range(10):
        scan, truth = half_scan(part, generator)
        try:
            both = register(scan, part).T_target_scan @ truth
        except NotRegistered:
            refused += 1
            continue
        turn = np.linalg.norm(both[:3, :3] - np.eye(3)) / np.sqrt(2)
        angles.append(np.degrees(2 * np.arcsin(min(turn / 2, 1.0))))
        shifts.append(float(np.linalg.norm(both[:3, :3] @ middle + both[:3, 3] - middle)))
    good = sum(s <= 0.02 and a <= 0.05 for s, a in zip(shifts, angles))
    print(
        f"ten noisy half scans of {LUMPY.stem}: {good} within 0.02 mm and 0.05 deg, {refused} "
        f"refused; median {np.median(shifts):.4f} mm, {np.median(angles):.4f} deg; "
        f"{(time.perf_counter() - began) / 10:.1f} s each"
    )


def main() -> int:
    """Run all three."""
    registration()
    cost()
    refinement()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
