# SPDX-License-Identifier: Apache-2.0
"""`summary.json`: what a script wants to know of a plan."""

from __future__ import annotations

import json
import resource
from typing import TYPE_CHECKING, Any

from vega_planner.datatypes import Part, PrintabilityReport

if TYPE_CHECKING:
    from vega_planner.pipeline import PrintPlan


def summarise(plan: PrintPlan) -> dict[str, Any]:
    """Collect the figures of a plan, with the keys other tools rely on."""
    part, stack, trajectory = plan.part, plan.stack, plan.trajectory
    return {
        "mesh": part.name,
        "engine": stack.engine,
        "layer_thickness_mm": stack.thickness_mm,
        "bead_width_mm": plan.settings.toolpaths.width_mm,
        "layers": len(stack.layers),
        "cores": [_core(layer) for layer in stack.cores],
        "volume_mm3": round(part.volume, 3),
        "brr": _restraint(part),
        "robot": plan.cell.robot.name,
        "tool": plan.cell.tool.name,
        "material": plan.cell.material.name,
        "plate_z_mm": plan.cell.placement.plate_z_mm,
        "T_base_part": trajectory.T_base_part.round(12).tolist(),
        "printability": _printability(plan.printability),
        "passes": len(plan.toolpaths.passes),
        "path_length_mm": round(plan.toolpaths.path_length_mm, 3),
        "travel_length_mm": round(plan.toolpaths.travel_length_mm, 3),
        "print_time_s": round(trajectory.duration_s, 3),
        "slow_ratio": round(trajectory.slow_ratio, 6),
        "material_mm3": round(plan.coverage.deposited_mm3, 3),
        "prime_mm3": round(plan.prime_mm3, 3),
        "coverage": {
            "under_ratio": round(plan.coverage.under_ratio, 6),
            "over_ratio": round(plan.coverage.over_ratio, 6),
            "uncovered_core_ratio": round(stack.uncovered_ratio, 6),
            "overfilled_core_ratio": round(stack.overfill_ratio, 6),
        },
        "collisions": plan.collisions,
        "warnings": list(plan.warnings),
        "stages": {name: round(seconds, 4) for name, seconds in plan.seconds.items()},
        "total_s": round(sum(plan.seconds.values()), 4),
        "peak_memory_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, 1),
    }


def summary_json(summary: dict[str, Any]) -> bytes:
    """Print a summary as JSON, keys in the order they were collected."""
    return (json.dumps(summary, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode()


def _core(layer: Any) -> dict[str, float]:
    return {
        "depth_mm": round(layer.depth_mm, 4),
        "thickness_min_mm": round(float(layer.thickness.min()), 4),
        "thickness_max_mm": round(float(layer.thickness.max()), 4),
    }


def _restraint(part: Part) -> dict[str, Any]:
    return {
        "spec": list(part.brr),
        "faces": int(part.restrained.sum()),
        "area_mm2": round(float(part.face_areas[part.restrained].sum()), 3),
    }


def _printability(report: PrintabilityReport) -> dict[str, Any]:
    return {
        "status": report.status,
        "reachable_ratio": round(report.reachable_ratio, 6),
        "accessible_ratio": round(report.accessible_ratio, 6),
        "collision_free_ratio": round(report.collision_free_ratio, 6),
        "split_layers": report.split_layers,
        "reasons": [
            {
                "code": reason.code,
                "layer": reason.layer,
                "area_mm2": round(reason.area_mm2, 3),
                "where_mm": [round(value, 3) for value in reason.where_mm],
                "remedy": reason.remedy,
            }
            for reason in report.reasons
        ],
    }
