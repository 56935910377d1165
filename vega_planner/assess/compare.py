# SPDX-License-Identifier: Apache-2.0
"""Enveloping against planar slicing: two virtual prints of one part, side by side."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vega_planner.assess.closest import SurfaceDistance
from vega_planner.assess.fidelity import Deviation, measure_deviation
from vega_planner.assess.fidelity_page import (
    MEASURES,
    change,
    heat_limit,
    heat_maps,
    measures_table,
    part_picture,
)
from vega_planner.assess.virtual_print import read_target
from vega_planner.datatypes import Layer, Part, TriangleGeometry
from vega_planner.errors import InvalidInput
from vega_planner.viewer.charts import heat_scale, violins
from vega_planner.viewer.html_page import figure, page, row, table
from vega_planner.viewer.pictures import View, data_uri, draw

#: Figures of `summary.json` worth comparing: name for a person, unit, factor, decimals.
_JOB = {
    "path_length_mm": ("path length", "m", 1e-3, 3),
    "travel_length_mm": ("travel", "m", 1e-3, 3),
    "print_time_s": ("print time", "min", 1 / 60, 1),
    "material_mm3": ("material", "ml", 1e-3, 3),
    "layers": ("layers", "", 1, 0),
    "total_s": ("computing time", "s", 1, 2),
}
NAMES = {"slice": "planar", "plan": "enveloping"}


@dataclass(frozen=True, eq=False)
class _Print:
    """A result folder with its virtual print."""

    target: Part
    layers: tuple[Layer, ...]
    vertices: np.ndarray
    faces: np.ndarray
    deviation: Deviation
    fidelity: dict[str, Any]
    summary: dict[str, Any]


def compare_folders(
    plan_dir: str | Path, slice_dir: str | Path, out: str | Path
) -> dict[str, Any]:
    """Compare two simulated result folders; writes `report.html` and `comparison.json`.

    Args:
        plan_dir: Result folder of `vega plan`, simulated.
        slice_dir: Result folder of `vega slice` of the same part, simulated.
        out: Folder to write.

    Returns:
        For "planar" and "enveloping" the measures and the job's figures, and under
        "change_pct" how the second differs from the first.

    Raises:
        InvalidInput: If a folder holds no virtual print.
        OutputError: If the report cannot be written.
    """
    from vega_planner.results.folder import write_folder

    planar, enveloping = _read(Path(slice_dir)), _read(Path(plan_dir))
    result = _figures(planar, enveloping)
    write_folder(
        out,
        {
            "report.html": _page(planar, enveloping),
            "comparison.json": (json.dumps(result, indent=2) + "\n").encode(),
        },
    )
    return result


def _read(folder: Path) -> _Print:
    from vega_planner.results.ply import read_mesh_ply

    try:
        fidelity = json.loads((folder / "fidelity.json").read_text(encoding="utf-8"))
        summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InvalidInput(f"{folder} holds no virtual print; run 'vega simulate'") from error
    target = read_target(folder)
    vertices, faces, _ = read_mesh_ply(folder / "printed.ply")
    surface = SurfaceDistance(target.vertices, target.faces)
    kind = "planar" if summary.get("engine") == "planar" else "envelope"
    layers = []
    for index, path in enumerate(sorted((folder / "layers").glob("*.ply"))):
        points, triangles, extra = read_mesh_ply(path)
        thickness = extra.get("thickness", np.full(len(points), 1.0))
        layers.append(Layer(index, kind, 0.0, points, triangles, np.maximum(thickness, 1e-6)))
    return _Print(
        target=target,
        layers=tuple(layers),
        vertices=vertices,
        faces=faces,
        deviation=measure_deviation(vertices, faces, surface, target.restrained),
        fidelity=fidelity,
        summary=summary,
    )


def _figures(planar: _Print, enveloping: _Print) -> dict[str, Any]:
    columns = {
        name: {
            **item.fidelity,
            **{key: item.summary[key] for key in _JOB if key in item.summary},
        }
        for name, item in (("planar", planar), ("enveloping", enveloping))
    }
    changes: dict[str, Any] = {}
    for key in (*MEASURES, *_JOB):
        if key in columns["planar"] and key in columns["enveloping"]:
            changes[key] = _percent(columns["planar"][key], columns["enveloping"][key])
    changes["free"] = {
        key: _percent(columns["planar"]["free"][key], columns["enveloping"]["free"][key])
        for key in MEASURES
    }
    return {**columns, "change_pct": changes}


def _percent(old: float, new: float) -> float | None:
    return round(100 * (new / old - 1), 2) if old else None


def _page(planar: _Print, enveloping: _Print) -> bytes:
    from vega_planner.viewer.plan_page import layer_scene

    limit = heat_limit(planar.deviation, enveloping.deviation)
    both = {"planar": planar, "enveloping": enveloping}
    prints = [
        part_picture(planar.target, "Target"),
        *(part_picture(_Surface(item), f"Virtual print, {name}") for name, item in both.items()),
    ]
    layers = [
        figure(data_uri(draw(layer_scene(item.layers), View())), f"Layers, {name}, cut open")
        for name, item in both.items()
    ]
    maps = [
        row(heat_maps(item.vertices, item.faces, item.deviation.signed, limit, name))
        for name, item in both.items()
    ]
    groups = {
        name: (np.abs(item.deviation.signed), item.deviation.areas) for name, item in both.items()
    }
    free = {name: item.fidelity["free"] for name, item in both.items()}
    sections = [
        row(prints),
        row(layers),
        "<h2>Fidelity, surfaces that are not restrained</h2>",
        measures_table(free, changes=True),
        "<h2>Fidelity, everywhere</h2>",
        measures_table({name: item.fidelity for name, item in both.items()}, changes=True),
        "<h2>Job</h2>",
        _job_table(planar.summary, enveloping.summary),
        "<h2>Where they deviate</h2>",
        *maps,
        figure(heat_scale(limit, "deviation [mm]: inside – outside"), ""),
        "<h2>Distribution of the deviation</h2>",
        figure(
            violins(groups, "absolute deviation [mm]"),
            "Absolute surface deviation by area; the dash is the mean",
        ),
        "<p>A virtual print knows no sagging and no die swell: compare its figures with "
        "each other, not with those of a scanned print.</p>",
    ]
    gain = change(planar.fidelity["free"]["e2_mean_mm"], enveloping.fidelity["free"]["e2_mean_mm"])
    lead = f"surface deviation {gain} against planar slicing, where not restrained"
    return page(f"Comparison: {planar.summary.get('mesh', planar.target.name)}", lead, sections)


class _Surface(TriangleGeometry):
    """The printed surface as a mesh to draw."""

    def __init__(self, item: _Print) -> None:
        self.vertices, self.faces = item.vertices, item.faces


def _job_table(planar: dict[str, Any], enveloping: dict[str, Any]) -> str:
    rows = []
    for key, (words, unit, factor, decimals) in _JOB.items():
        if key in planar and key in enveloping:
            values = [float(item[key]) * factor for item in (planar, enveloping)]
            shown = [f"{value:.{decimals}f}" for value in values]
            rows.append((f"{words} [{unit}]" if unit else words, *shown, change(*values)))
    return table(("", "planar", "enveloping", "change"), rows)
