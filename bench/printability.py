# SPDX-License-Identifier: Apache-2.0
"""Reach, solid check, split and order: misses and errors first, then CPU seconds.

Run: python bench/printability.py
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path = [path for path in sys.path if Path(path).resolve() != ROOT / "bench"]
sys.path[:0] = [str(ROOT), str(ROOT / "test")]

from printability import test_clearance as oracle
from printability.envelopes import default_cell, ellipsoid

from vega_planner.datatypes import TriangleGeometry
from vega_planner.ordering import order_patches
from vega_planner.printability import assess_printability
from vega_planner.printability.islands import neighbours_of
from vega_planner.printability.material import mesh_field
from vega_planner.printability.tool_shape import ToolShape
from vega_planner.progress import silent
from vega_planner.robot.robot import load_robot
from vega_planner.settings import PrintabilitySettings
from vega_planner.splitting import split_layers
from vega_planner.splitting.border import separating_field
from vega_planner.splitting.cut import cut_mesh
from vega_planner.substrate import stand_on_substrate

RUNS = 5


def seconds(work: Callable[[], Any], runs: int = RUNS) -> dict[str, float]:
    """Shortest wall and CPU time of some runs, after one that loads what is compiled."""
    work()
    wall, used = [], []
    for _ in range(runs):
        begin, cpu = time.perf_counter(), time.process_time()
        work()
        wall.append(time.perf_counter() - begin)
        used.append(time.process_time() - cpu)
    return {"wall_s": round(min(wall), 4), "cpu_s": round(min(used), 4)}


def reach(name: str) -> dict[str, Any]:
    """Reach of 50,000 poses, and what is missed of 20,000 that are known to be reachable."""
    robot = load_robot(name)
    rng = np.random.default_rng(5)
    low = np.maximum(robot.lower, -2 * np.pi)
    high = np.minimum(robot.upper, 2 * np.pi)
    points, axes = robot.forward(rng.uniform(low, high, (50_000, len(low))))
    missed = int((~robot.reachable(points[:20_000], axes[:20_000])).sum())
    return {"missed_of_20000": missed} | seconds(lambda: robot.reachable(points, axes), 3)


def solid_check() -> dict[str, Any]:
    """Missed and false alarms against convex bodies with containment, and poses per second."""
    mesh = oracle.peanut()
    rng = np.random.default_rng(7)
    face = rng.integers(0, len(mesh.faces), 8000)
    tips = mesh.vertices[mesh.faces[face]].mean(1)
    result: dict[str, Any] = {}
    tool = ToolShape.of(oracle.TOOL, oracle.START)
    field = mesh_field(mesh, 0.65)
    for name, noise in (("poses", 0.5), ("hard poses", 1.0)):
        axes = mesh.face_normals[face] + noise * rng.normal(size=(8000, 3))
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        exact = oracle.exact_hits(mesh, tips, axes)
        alarm = field.clearance(tool, tips, axes, 0.2, 0.2) < 0.2
        result[name] = {
            "colliding": int(exact.sum()),
            "missed_of_8000": int((exact & ~alarm).sum()),
            "false_pct": round(100 * float((alarm & ~exact).mean()), 2),
        }
    axes = mesh.face_normals[face]
    many = (np.tile(tips, (25, 1)), np.tile(axes, (25, 1)))
    took = seconds(lambda: field.clearance(tool, *many, 0.2, 0.2))
    result["million_poses_per_cpu_s"] = round(len(many[0]) / took["cpu_s"] / 1e6, 2)
    return result


@dataclass(frozen=True, eq=False)
class Sheet(TriangleGeometry):
    """A mesh to cut."""

    vertices: np.ndarray
    faces: np.ndarray


def split() -> dict[str, Any]:
    """A shell of 20,480 triangles cut at a wavy border whose labels are noisy."""
    import trimesh

    ball = trimesh.creation.icosphere(5)
    sheet = Sheet(np.array(ball.vertices) * [26.0, 22.0, 20.0], np.array(ball.faces))
    unit = np.array(ball.vertices)
    turn = np.arctan2(unit[:, 1], unit[:, 0])
    truth = np.degrees(np.arccos(np.clip(unit[:, 2], -1, 1))) - 95 - 6 * np.sin(3 * turn)
    rng = np.random.default_rng(3)
    noisy = truth[sheet.faces].mean(1) + rng.normal(0, 1.5, len(sheet.faces)) < 0
    neighbours = neighbours_of(sheet)

    def cut() -> Any:
        field, _ = separating_field(sheet, neighbours, noisy)
        return cut_mesh(sheet.vertices, sheet.faces, field)

    done = cut()
    corners = done.vertices[done.faces]
    area = 0.5 * np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    below = done.carry(truth)[done.faces].mean(1) < 0
    labels = noisy != (truth[sheet.faces].mean(1) < 0)
    before = float(sheet.face_areas[labels].sum()) / sheet.area
    return {
        "triangles": len(sheet.faces),
        "area_error": float(abs(area.sum() / sheet.area - 1)),
        "mislabelled_before_pct": round(100 * before, 3),
        "mislabelled_pct": round(100 * float(area[below != done.positive].sum() / area.sum()), 3),
    } | seconds(cut)


def order() -> dict[str, Any]:
    """Bowls and caps of nested shells on a substrate."""
    settings = PrintabilitySettings()
    stack = ellipsoid(26.0, 23.0, 19.0, 0.8)
    cell = stand_on_substrate(default_cell(), stack.part)
    assessment = assess_printability(stack, cell, settings, silent)
    patches = split_layers(stack, assessment, cell, settings, silent)
    took = seconds(lambda: order_patches(patches, stack, cell, settings, silent, assessment), 3)
    found = order_patches(patches, stack, cell, settings, silent, assessment)
    return {"patches": len(patches), "violations": len(found.violations())} | took


def main() -> int:
    result = {
        "reach vega5": reach("vega5"),
        "reach ur5e": reach("ur5e"),
        "solid check": solid_check(),
        "split": split(),
        "order": order(),
    }
    print(json.dumps(result, indent=2))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
