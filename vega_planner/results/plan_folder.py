# SPDX-License-Identifier: Apache-2.0
"""The files of a plan's result folder."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vega_planner.datatypes import Ints, Layer, Part, Patch
from vega_planner.parallel import map_threads
from vega_planner.results.folder import write_folder
from vega_planner.results.ply import mesh_ply
from vega_planner.results.stl import mesh_stl
from vega_planner.results.summary import summary_json
from vega_planner.results.tables import toolpath_csv, trajectory_csv, velocities_csv
from vega_planner.settings import as_dict

if TYPE_CHECKING:
    from vega_planner.pipeline import PrintPlan

#: What an earlier result may have left that no longer belongs to a new one.
OBSOLETE = (
    "restraint.ply",
    "substrate.stl",
    "layers",
    "patches",
    "printed.ply",
    "fidelity.json",
    "compare",
    "report.html",
)


def write_plan(plan: PrintPlan, folder: str | Path) -> Path:
    """Write a plan, whole or not at all.

    Returns:
        The folder's absolute path.

    Raises:
        OutputError: If the folder cannot be written; it is then as it was.
    """
    from vega_planner.viewer.plan_page import pictures_of, plan_page

    pictures = pictures_of(plan)
    files = _files(plan)
    makers = (*reversed(pictures), *files.values())  # what takes longest first
    made: list[Any] = map_threads(lambda make: make(), makers)
    drawn, contents = made[: len(pictures)], made[len(pictures) :]
    written = dict(zip(files, contents, strict=True))
    written["plan.html"] = plan_page(plan, drawn[::-1])
    written["certificate.json"] = _json(plan.certificate)
    written["settings.yaml"] = _yaml(as_dict(plan.settings))
    written["summary.json"] = summary_json(plan.summary)
    return write_folder(folder, written, OBSOLETE)


def _files(plan: PrintPlan) -> dict[str, Callable[[], bytes]]:
    """Name the tables and meshes of a plan, each with what makes it."""
    files: dict[str, Callable[[], bytes]] = {
        "trajectory.csv": lambda: trajectory_csv(plan.trajectory),
        "velocities.csv": lambda: velocities_csv(plan.trajectory),
        "toolpath.csv": lambda: toolpath_csv(plan.toolpaths),
        "part.ply": lambda: mesh_ply(plan.part.vertices, plan.part.faces),
    }
    if plan.part.restrained.any():
        files["restraint.ply"] = lambda: _restraint_ply(plan.part)
    substrate = plan.cell.substrate
    if substrate is not None:
        files["substrate.stl"] = lambda: mesh_stl(substrate)
    reasons = plan.printability.face_reasons or (None,) * len(plan.stack.sheets)
    envelopes = len(plan.stack.layers)
    for index, (layer, reason) in enumerate(zip(plan.stack.sheets, reasons, strict=True)):
        name = f"layer_{index:03d}" if index < envelopes else f"core_{index - envelopes:03d}"
        files[f"layers/{name}.ply"] = partial(_layer_ply, layer, reason)
    for index, patch in enumerate(plan.patches):
        files[f"patches/patch_{index:03d}.ply"] = partial(_patch_ply, patch)
    return files


def _json(values: dict) -> bytes:
    return (json.dumps(values, indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode()


def _yaml(values: dict) -> bytes:
    import yaml

    return yaml.safe_dump(values, sort_keys=False, allow_unicode=True).encode()


def _restraint_ply(part: Part) -> bytes:
    faces = part.faces[part.restrained]
    used, flat = np.unique(faces, return_inverse=True)
    return mesh_ply(part.vertices[used], flat.reshape(-1, 3))


def _layer_ply(layer: Layer, reasons: Ints | None) -> bytes:
    """A layer; `reason` is 0 where a face is printable, else 1 + index of `REASON_CODES`."""
    marks = {} if reasons is None else {"reason": reasons}
    return mesh_ply(layer.vertices, layer.faces, {"thickness": layer.thickness}, marks)


def _patch_ply(patch: Patch) -> bytes:
    axes = {f"tool_{axis}": patch.tool_axes[:, k] for k, axis in enumerate("xyz")}
    return mesh_ply(patch.vertices, patch.faces, {"thickness": patch.thickness, **axes})
