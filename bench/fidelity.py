# SPDX-License-Identifier: Apache-2.0
"""Fidelity of virtual prints: planar, enveloping with Euclidean and geodesic spacing.

    .venv/bin/python bench/fidelity.py                   the six parts
    .venv/bin/python bench/fidelity.py parts/part1_dome.stl --voxel 0.15
    .venv/bin/python bench/fidelity.py --slicer          PrusaSlicer's G-code as well

    .venv/bin/python bench/fidelity.py --beside spot.obj other meshes beside them

Plans each part three times, prints it virtually, and writes `fidelity.json` and
`fidelity.md` to docs/results, with the paper's figures beside ours. Both files are
written anew after each part, so that a run that is stopped leaves what it measured.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from vega_planner.assess.fidelity_page import MEASURES
from vega_planner.assess.slicer_gcode import read_gcode
from vega_planner.assess.virtual_print import simulate
from vega_planner.datatypes import Part
from vega_planner.errors import VegaError
from vega_planner.part import load_part
from vega_planner.pipeline import PrintPlan, plan
from vega_planner.settings import Settings, load_settings

ROOT = Path(__file__).resolve().parent.parent
MODES: dict[str, dict[str, Any]] = {
    "planar": {
        "layers": {"engine": "planar"},
        "printability": {"orientation": "vertical"},
        "toolpaths": {"pattern": "contour", "spacing": "euclidean"},
    },
    "enveloping, Euclidean": {"toolpaths": {"pattern": "zigzag", "spacing": "euclidean"}},
    "enveloping, geodesic": {},
}
SLICER = "PrusaSlicer"
#: One wall, concentric infill, and the bead and layers of the other modes.
SLICER_OPTIONS = (
    "--export-gcode --layer-height 0.8 --first-layer-height 0.8 --nozzle-diameter 1.2 "
    "--extrusion-width 1.2 --perimeters 1 --fill-density 100% --fill-pattern concentric "
    "--top-solid-layers 0 --bottom-solid-layers 0 --filament-diameter 1.75 --loglevel 1"
)
JOB = {
    "path_length_mm": "path length [mm]",
    "print_time_s": "print time [s]",
    "deposited_ratio": "bead volume / volume",
    "total_s": "computing time [s]",
    "simulate_s": "virtual print [s]",
    "status": "printable",
}
#: Largest dimension to which meshes beside the parts are scaled [mm].
BESIDE_MM = 36.0
#: The paper's figures: mean and standard deviation over its scanned parts.
PAPER = """| | planar | enveloping, Euclidean | change |
| --- | --- | --- | --- |
| volumetric error e1 | | | -68.5 % |
| overshoot | | | -88.5 % |
| undershoot | | | +113.7 % |
| surface deviation e2 [mm] | 0.342 ± 0.129 | 0.106 ± 0.019 | -69.1 % |
| chamfer distance e3 | 0.397 ± 0.297 | 0.088 ± 0.012 | -77.9 % (not significant) |
| path length | | | differs by 5.4 ± 2.3 % |
| computing time [s] | | 32 ± 7 | |
"""
NOTE = """Planar stands for `vega slice`, walls and concentric infill of the whole part, on the
same substrate where the part needs one, also where its upright nozzle would touch that;
enveloping, Euclidean, for the paper's projected zigzag lines; enveloping, geodesic, for
what `vega plan` does.
PrusaSlicer's rows are its own G-code of the same part, layer and bead, read back and
printed by the same means; they enter no mean.

What can be compared with the paper, and what cannot:

- A virtual print lays down ideal beads: nothing sags, swells or slips, and what two
  beads claim twice does not flow elsewhere. So the figures are below the paper's, which
  come from scans of silicone prints and hold the errors of material, machine and
  scanner. Absolute figures do not compare.
- The change from planar to enveloping compares in kind: both use one bead, layer and
  speed. The parts are drawn after the paper's and are not the same bodies.
- Closed voids count as printed, as a scan cannot see them. Where the bead's volume is
  well below the part's (the table of the job), the inside is not filled, and e1 does not
  show it.
- Open pits count with their walls. Where gaps between beads join from layer to layer,
  the outer surface reaches deep inside; then e2's deviation and e3, which squares, are
  mostly those of the pits.
- Prints are taken off their substrate before they are looked at, and cut where it stood.
- Meshes beside the parts are scaled to one size, lie as their files say, and enter no
  mean. Where less than everything can be printed (the table of the job), what is left
  out counts as undershoot.
- e3 is the limit for dense point sets; the paper's, between vertices, also grows with
  the distance of the vertices.
- Computing times are of one run on a machine that did other work as well.

"Not restrained" counts only where the closest point of the target lies outside the
restraint region; "everywhere" counts all, the base on the plate included.
"""


def settings_of(path: Path) -> Settings:
    beside = path.with_suffix(".yaml")
    return load_settings(beside, Settings()) if beside.exists() else Settings()


def figures_of(result: PrintPlan, voxel_mm: float) -> dict[str, Any]:
    """Print a plan virtually and measure it."""
    return simulate(
        result.toolpaths,
        result.part,
        voxel_mm=voxel_mm,
        plate_z_mm=result.cell.placement.plate_z_mm,
        substrate=result.cell.substrate,
    ).as_dict()


def measure(path: Path, mode: str, voxel_mm: float) -> dict[str, Any]:
    settings = settings_of(path)
    began = time.perf_counter()
    result = plan(path, settings.updated(MODES[mode]))
    planned = time.perf_counter()
    figures = figures_of(result, voxel_mm)
    return {
        **figures,
        "path_length_mm": result.toolpaths.path_length_mm,
        "print_time_s": result.trajectory.duration_s,
        "deposited_ratio": figures["bead_volume_mm3"] / result.part.volume,
        "total_s": planned - began,
        "simulate_s": time.perf_counter() - planned,
        "status": result.printability.status,
    }


def scaled(path: Path, folder: Path) -> Path:
    """Write a mesh scaled to `BESIDE_MM` as STL."""
    import trimesh

    mesh: Any = trimesh.load(path, force="mesh", process=False)
    mesh.apply_scale(BESIDE_MM / mesh.extents.max())
    file = folder / f"{path.stem}.stl"
    mesh.export(file)
    return file


def measure_slicer(path: Path, voxel_mm: float) -> dict[str, Any] | None:
    """Slice a part that stands on a flat base with PrusaSlicer; None where it does not."""
    target = load_part(path, settings_of(path).part)
    if not (target.restrained.any() and (target.face_normals[target.restrained, 2] < -0.99).all()):
        return None
    with tempfile.TemporaryDirectory() as folder:
        gcode = Path(folder) / "part.gcode"
        began = time.perf_counter()
        command = ["prusa-slicer", *SLICER_OPTIONS.split(), "-o", str(gcode), str(path)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, timeout=120)
        sliced = time.perf_counter()
        return {**measure_gcode(gcode, target, voxel_mm), "total_s": sliced - began}


def measure_gcode(path: Path, target: Part, voxel_mm: float) -> dict[str, Any]:
    """Print another slicer's G-code virtually, its box over the middle of the target's."""
    middle = target.bounds.mean(0)
    beads = read_gcode(path, layer_height_mm=0.8, centre=(middle[0], middle[1]))
    began = time.perf_counter()
    figures = simulate(beads, target, voxel_mm=voxel_mm).as_dict()
    return {
        **figures,
        "path_length_mm": beads.length_mm,
        "deposited_ratio": figures["bead_volume_mm3"] / target.volume,
        "simulate_s": time.perf_counter() - began,
    }


def paired(old: list[float], new: list[float]) -> str:
    """Change of the mean of paired figures, and the paired tests of their difference."""
    from scipy.stats import ttest_rel, wilcoxon

    if not old or not sum(old):
        return "–"
    text = f"{100 * (sum(new) / sum(old) - 1):+.1f} %"
    if len(old) > 2 and old != new:
        t_test, rank = ttest_rel(old, new).pvalue, wilcoxon(old, new).pvalue
        text += f" (t test p = {t_test:.3f}, Wilcoxon p = {rank:.3f})"
    return text


def tables(record: dict[str, Any]) -> str:
    """Write the document; means and changes are over the parts printed in every mode."""
    results: dict[str, dict[str, dict[str, Any]]] = record["parts"]
    beside = record.get("beside", [])
    whole = {
        part: modes
        for part, modes in results.items()
        if all(m in modes for m in MODES) and part not in beside
    }
    lines = [
        "# Fidelity of virtual prints",
        "",
        f"Written by `bench/fidelity.py`, voxels of {record['voxel_mm']} mm, at commit "
        f"{record['commit']}; {len(whole)} parts.",
        "",
        NOTE,
    ]
    for title, pick in (
        ("Surfaces that are not restrained", lambda row: row["free"]),
        ("Everywhere", lambda row: row),
    ):
        lines += [f"## {title}", "", *_measures(results, whole, pick), ""]
        lines += ["Change of the mean against planar, and the paired tests over the parts:", ""]
        lines += [
            "| measure | enveloping, Euclidean | enveloping, geodesic |",
            "| --- | --- | --- |",
        ]
        for key, (words, _, _) in MEASURES.items():
            columns = {
                mode: [float(pick(modes[mode])[key]) for modes in whole.values()] for mode in MODES
            }
            cells = [paired(columns["planar"], columns[mode]) for mode in list(MODES)[1:]]
            lines.append(f"| {_escaped(words)} | " + " | ".join(cells) + " |")
        lines.append("")
    lines += ["## Job", "", "| part | layers | " + " | ".join(JOB.values()) + " |"]
    lines.append("| --- " * (2 + len(JOB)) + "|")
    for part, modes in results.items():
        for mode, row in modes.items():
            cells = [_cell(row.get(key)) for key in JOB]
            lines.append(f"| {part} | {mode} | " + " | ".join(cells) + " |")
    lengths = {mode: [m[mode]["path_length_mm"] for m in whole.values()] for mode in MODES}
    lines.append("")
    lines += [
        f"Path length against planar, {mode}: {paired(lengths['planar'], lengths[mode])}.  "
        for mode in list(MODES)[1:]
    ]
    return "\n".join([*lines, "", "## The paper", "", PAPER.rstrip()])


def _cell(value: float | str | None) -> str:
    if value is None:
        return "–"
    return value if isinstance(value, str) else f"{value:.3f}"


def _escaped(words: str) -> str:
    """Keep the bars of |e2| from cutting a table's cell."""
    return words.replace("|", "\\|")


def _measures(
    results: dict[str, dict[str, dict[str, Any]]],
    whole: dict[str, dict[str, dict[str, Any]]],
    pick: Callable[[dict[str, Any]], dict[str, Any]],
) -> list[str]:
    """Set out every part's measures, and their means."""
    heads = [f"{_escaped(words)} [{unit}]" for words, unit, _ in MEASURES.values()]
    lines = ["| part | layers | " + " | ".join(heads) + " |", "| --- " * (2 + len(heads)) + "|"]
    for part, modes in results.items():
        for mode, row in modes.items():
            cells = [f"{pick(row)[key]:.{d}f}" for key, (_, _, d) in MEASURES.items()]
            lines.append(f"| {part} | {mode} | " + " | ".join(cells) + " |")
    for mode in MODES if whole else ():
        cells = []
        for key, (_, _, d) in MEASURES.items():
            values = [float(pick(modes[mode])[key]) for modes in whole.values()]
            cells.append(f"{np.mean(values):.{d}f} ± {np.std(values, ddof=len(values) > 1):.{d}f}")
        lines.append(f"| **mean** | {mode} | " + " | ".join(cells) + " |")
    return lines


def revision() -> str:
    """Name the commit that is measured, with a mark where files of it were changed."""
    try:
        command = ["git", "-C", str(ROOT), "describe", "--always", "--dirty", "--exclude", "*"]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def write(record: dict[str, Any], folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "fidelity.json").write_text(json.dumps(record, indent=2) + "\n")
    (folder / "fidelity.md").write_text(tables(record) + "\n")


def row_of(path: Path, mode: str, voxel_mm: float) -> dict[str, Any] | None:
    try:
        if mode == SLICER:
            return measure_slicer(path, voxel_mm)
        return measure(path, mode, voxel_mm)
    except (VegaError, subprocess.SubprocessError) as error:
        print(f"{path.stem} {mode}: {type(error).__name__}: {error}", flush=True)
        return None


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", type=Path, help="mesh files; the six parts if none")
    parser.add_argument("--voxel", type=float, default=0.1, metavar="MM")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "docs" / "results")
    parser.add_argument("--modes", nargs="*", choices=list(MODES), default=list(MODES))
    parser.add_argument(
        "--slicer", action="store_true", help="PrusaSlicer too, where a part's base is flat"
    )
    parser.add_argument(
        "--beside", nargs="*", type=Path, default=[], help="other meshes, beside the means"
    )
    parser.add_argument("--keep", action="store_true", help="keep the other rows of the last run")
    options = parser.parse_args()
    if options.slicer and not shutil.which("prusa-slicer"):
        parser.error("prusa-slicer is not installed (Debian: apt-get install prusa-slicer)")
    paths = options.parts or sorted((ROOT / "parts").glob("part*.stl"))
    results: dict[str, dict[str, dict[str, Any]]] = {}
    beside: list[str] = []
    last = options.output / "fidelity.json"
    if options.keep and last.exists():
        old = json.loads(last.read_text())
        results, beside = old["parts"], old.get("beside", [])
        paths = options.parts
    beside = sorted({*beside, *(path.stem for path in options.beside)})
    record = {
        "commit": revision(), "voxel_mm": options.voxel, "parts": results, "beside": beside,
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        paths = [*paths, *(scaled(path, Path(folder)) for path in options.beside)]
        run(paths, options, record)
    print(f"written: {options.output / 'fidelity.md'}")
    return 0


def run(paths: list[Path], options: argparse.Namespace, record: dict[str, Any]) -> None:
    """Measure parts one after the other, and write what there is after each."""
    results = record["parts"]
    for path in paths:
        for mode in [*options.modes, *([SLICER] if options.slicer else [])]:
            row = row_of(path, mode, options.voxel)
            if row is None:
                continue
            results.setdefault(path.stem, {})[mode] = row
            shown = ", ".join(f"{k} {row['free'][k]:.4f}" for k in MEASURES)
            print(f"{path.stem} {mode}: {shown}", flush=True)
        write(record, options.output)


if __name__ == "__main__":
    raise SystemExit(main())
