# SPDX-License-Identifier: Apache-2.0
"""Whole processes, imports included: seconds and peak memory of `vega`, beside a slicer."""

from __future__ import annotations

import json
import os
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "tools")]

VEGA = Path(sys.executable).parent / "vega"
RUNS = 5
#: Arguments of the planar slicer that make its job comparable: one wall, concentric infill,
#: the same layer and bead.
SLICER = (
    "--export-gcode --layer-height 0.8 --first-layer-height 0.8 --nozzle-diameter 1.2 "
    "--extrusion-width 1.2 --perimeters 1 --fill-density 100% --fill-pattern concentric "
    "--top-solid-layers 0 --bottom-solid-layers 0 --filament-diameter 1.75 --loglevel 1"
)


def dome(faces: int) -> tuple[np.ndarray, np.ndarray]:
    """A half ball of 40 mm on its flat base with about so many triangles."""
    from kernel_cases import half_ball

    turns = int(np.sqrt(faces * 1.4))
    return half_ball(20.0, faces // (2 * turns), turns)


def lobed(faces: int) -> tuple[np.ndarray, np.ndarray]:
    """A dome of 50 mm with lobes."""
    vertices, triangles = dome(faces)
    turn = np.arctan2(vertices[:, 1], vertices[:, 0])
    swell = 1.25 * (1 + 0.06 * np.cos(5 * turn) * np.hypot(*vertices[:, :2].T) / 20.0)
    return vertices * swell[:, None], triangles


def write_stl(path: Path, vertices: np.ndarray, faces: np.ndarray) -> None:
    rows = np.zeros(len(faces), [("n", "<f4", 3), ("p", "<f4", (3, 3)), ("a", "<u2")])
    rows["p"] = vertices[faces]
    path.write_bytes(b"\0" * 80 + np.uint32(len(faces)).tobytes() + rows.tobytes())


def timed(command: list[str]) -> tuple[float, float]:
    """Wall seconds and peak megabytes of one process."""
    began = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    if os.waitstatus_to_exitcode(status) not in (0, 3):
        raise SystemExit(f"{' '.join(command)} failed")
    return time.perf_counter() - began, usage.ru_maxrss / 1024


def median(command: list[str], runs: int = RUNS) -> dict[str, float]:
    timed(command)
    rows = [timed(command) for _ in range(runs)]
    return {
        "seconds": round(statistics.median(row[0] for row in rows), 3),
        "peak_memory_mb": round(max(row[1] for row in rows), 1),
    }


def main() -> int:
    result: dict[str, object] = {"help": median([str(VEGA), "--help"])}
    slicer = shutil.which("prusa-slicer")
    with tempfile.TemporaryDirectory() as folder:
        for name, mesh in (("dome 40 mm, 6k", dome(6000)), ("lobed 50 mm, 70k", lobed(70000))):
            stl = Path(folder) / "part.stl"
            write_stl(stl, *mesh)
            row: dict[str, Any] = {"triangles": len(mesh[1])}
            for command in ("plan", "slice"):
                row[command] = median(
                    [str(VEGA), command, str(stl), "-o", f"{folder}/out", "--brr", "down", "-q"]
                )
            if slicer:
                row["prusa-slicer"] = median(
                    [slicer, *SLICER.split(), "-o", f"{folder}/a.gcode", str(stl)]
                )
                row["plan / prusa-slicer"] = round(
                    row["plan"]["seconds"] / row["prusa-slicer"]["seconds"], 2
                )
            result[name] = row
    result["cores"] = len(os.sched_getaffinity(0))
    result["page_faults"] = resource.getrusage(resource.RUSAGE_CHILDREN).ru_majflt
    print(json.dumps(result, indent=2))
    if not slicer:
        print("prusa-slicer is not installed (Debian: apt-get install prusa-slicer): no ratio")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
