# SPDX-License-Identifier: Apache-2.0
"""Plan small parts that between them call every kernel; print one of them virtually."""

from __future__ import annotations

import os
import sys
import tempfile
import warnings
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

#: Settings that between them run every kernel, with the restraint region they are for.
CASES: tuple[tuple[str, dict[str, Any]], ...] = (
    ("down", {}),
    ("down", {"toolpaths": {"pattern": "zigzag"}}),
    ("down", {"toolpaths": {"pattern": "spiral"}}),
    ("down", {"toolpaths": {"pattern": "zigzag", "spacing": "euclidean"}}),
    ("none", {}),
    ("down", {"layers": {"engine": "planar"}, "printability": {"orientation": "vertical"}}),
)


def half_ball(radius: float = 6.0, rings: int = 12, turns: int = 32) -> tuple[Any, Any]:
    """Draw a half ball on a flat base: vertices [mm] (n, 3) and faces (m, 3)."""
    tilt = np.linspace(np.pi / 2, 0, rings, endpoint=False)
    turn = np.arange(turns) * 2 * np.pi / turns
    ring = [
        np.column_stack(
            [radius * np.sin(a) * np.cos(turn), radius * np.sin(a) * np.sin(turn),
             np.full(turns, radius * np.cos(a))]
        )
        for a in tilt
    ]  # fmt: skip
    vertices = np.vstack([*ring, [[0, 0, radius], [0, 0, 0]]])
    top, centre = rings * turns, rings * turns + 1
    faces = []
    for k in range(turns):
        n = (k + 1) % turns
        for i in range(rings - 1):
            a, b = i * turns + k, i * turns + n
            faces += [[a, b, b + turns], [a, b + turns, a + turns]]
        last = (rings - 1) * turns
        faces += [[last + k, last + n, top], [n, k, centre]]
    return vertices, np.array(faces)


def main() -> int:
    """Plan each case; print the first virtually. 1 where one could not be planned."""
    from vega_planner.assess.virtual_print import simulate_folder
    from vega_planner.errors import VegaError
    from vega_planner.pipeline import plan
    from vega_planner.settings import Settings

    warnings.simplefilter("ignore")
    mesh = half_ball()
    status = 0
    with tempfile.TemporaryDirectory() as folder:
        for index, (brr, changes) in enumerate(CASES):
            settings = Settings().updated({"part": {"brr": [brr]}, **changes})
            try:
                result = plan((*mesh, "half ball"), settings)
                if index == 0:
                    result.write(Path(folder) / "plan")
                    simulate_folder(Path(folder) / "plan", voxel_mm=0.4)
            except VegaError as error:
                print(f"kernels: case {changes or brr}: {error}", file=sys.stderr)
                status = 1
    return status


if __name__ == "__main__":
    raise SystemExit(main())
