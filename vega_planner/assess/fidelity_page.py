# SPDX-License-Identifier: Apache-2.0
"""Pages about the fidelity of prints: heat maps, violins, tables."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from vega_planner.assess.fidelity import Deviation, Fidelity, weighted_quantile
from vega_planner.datatypes import Floats, Ints, Part, TriangleGeometry
from vega_planner.viewer.charts import heat_scale, violins
from vega_planner.viewer.html_page import figure, page, row, table
from vega_planner.viewer.pictures import Scene, View, data_uri, diverging, draw

if TYPE_CHECKING:
    from vega_planner.assess.evaluate import Evaluation

VIEWS = {
    "from the front": View(-60, 28),
    "from behind": View(120, 28),
    "from above": View(-90, 85),
}
_GREY = (188, 196, 206)

#: Name of each measure for a person, its unit and its decimals.
MEASURES = {
    "e1_pct": ("volumetric error e1", "%", 3),
    "under_pct": ("undershoot", "%", 3),
    "over_pct": ("overshoot", "%", 3),
    "e2_mean_mm": ("surface deviation |e2|, mean", "mm", 4),
    "e2_std_mm": ("surface deviation |e2|, standard deviation", "mm", 4),
    "e2_p95_mm": ("surface deviation |e2|, 95 % below", "mm", 4),
    "e3_mm2": ("chamfer distance e3", "mm²", 5),
}


def heat_limit(*deviations: Deviation) -> float:
    """Choose the largest deviation that a heat map's colours tell apart [mm]."""
    limits = [weighted_quantile(np.abs(d.signed), d.areas, 0.97) for d in deviations]
    return max(round(max(limits), 2), 0.02)


def heat_maps(
    vertices: Floats, faces: Ints, signed: Floats, limit: float, name: str = ""
) -> list[str]:
    """Draw a surface coloured by its deviation from several sides, as figures."""
    scene = Scene()
    scene.add_mesh(vertices, faces, diverging(signed, limit))
    prefix = f"{name}, " if name else ""
    return [
        figure(data_uri(draw(scene, view)), f"{prefix}{words}") for words, view in VIEWS.items()
    ]


def part_picture(mesh: TriangleGeometry, caption: str) -> str:
    """Draw a plain mesh as a figure."""
    scene = Scene()
    scene.add_mesh(mesh.vertices, mesh.faces, _GREY)
    return figure(data_uri(draw(scene, View())), caption)


def measures_table(columns: Mapping[str, Mapping[str, Any]], changes: bool = False) -> str:
    """Set measures beside each other.

    Args:
        columns: Figures by the name of the column.
        changes: Whether to add how the last column differs from the first.
    """
    rows = []
    for key, (words, unit, decimals) in MEASURES.items():
        values = [float(column[key]) for column in columns.values()]
        cells: list[object] = [f"{words} [{unit}]", *(f"{value:.{decimals}f}" for value in values)]
        if changes:
            cells.append(change(values[0], values[-1]))
        rows.append(cells)
    head = ["", *columns, *(["change"] if changes else [])]
    return table(head, rows)


def change(old: float, new: float) -> str:
    """Say by how much a figure changed."""
    return f"{100 * (new / old - 1):+.1f} %" if old else "–"


def _absolute(deviation: Deviation) -> tuple[Floats, Floats]:
    return np.abs(deviation.signed), deviation.areas


def evaluation_page(target: Part, result: Evaluation) -> bytes:
    """Make the report of an evaluated scan."""
    where = result.registration
    limit = heat_limit(result.deviation)
    sure = "sure" if not where.ambiguous else "not sure: the part fits nearly as well elsewhere"
    sections = [
        "<h2>Measures</h2>",
        _two_tables(result.fidelity, result.free, bool(target.restrained.any())),
        "<h2>Where it deviates</h2>",
        row(heat_maps(result.scan.vertices, result.scan.faces, result.deviation.signed, limit)),
        figure(heat_scale(limit, "deviation [mm]: inside – outside"), ""),
        "<h2>Distribution</h2>",
        figure(
            violins({"print": _absolute(result.deviation)}, "absolute deviation [mm]"),
            "Absolute surface deviation by area; the dash is the mean",
        ),
        "<h2>Registration</h2>",
        table(
            (),
            [
                ("Certainty", f"{100 * where.certainty:.0f} % ({sure})"),
                ("Distance of what fits, root mean square", f"{where.rms_mm:.4f} mm"),
                ("Position known within", f"{where.sigma_mm:.4f} mm"),
                ("Direction known within", f"{where.sigma_deg:.4f}°"),
                ("Share of the scan that is print", f"{100 * where.used_ratio:.1f} %"),
                ("Share of the target that was scanned", f"{100 * result.coverage_ratio:.1f} %"),
                ("Volumes measured between", "closed solids" if result.closed else "surfaces"),
            ],
        ),
    ]
    lead = f"mean absolute deviation {result.fidelity.e2_mean_mm:.3f} mm"
    return page(f"Evaluation of {target.name}", lead, sections)


def _two_tables(everywhere: Fidelity, free: Fidelity, restrained: bool) -> str:
    columns = {"everywhere": everywhere.as_dict()}
    if restrained:
        columns["not restrained"] = free.as_dict()
    return measures_table(columns)
