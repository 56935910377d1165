# SPDX-License-Identifier: Apache-2.0
"""`plan.html`: what a person wants to see of a plan at a glance."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints, Layer, ToolpathSet
from vega_planner.parallel import map_threads
from vega_planner.viewer.html_page import bullets, figure, page, row, table, text
from vega_planner.viewer.pictures import Scene, View, data_uri, draw, sequential
from vega_planner.viewer.section import Cut, clipped

if TYPE_CHECKING:
    from vega_planner.pipeline import PrintPlan

_PART, _RESTRAINT, _UNPRINTABLE = (188, 196, 206), (230, 150, 40), (200, 40, 40)
_STATUS = {
    "fully": ("good", "fully printable"),
    "conditionally": ("fair", "printable after splitting"),
    "not": ("bad", "not printable"),
}
#: Points drawn of the toolpath; more do not show at the picture's size.
_MOST_POINTS = 60_000


def plan_page(plan: PrintPlan, pictures: Sequence[str] | None = None) -> bytes:
    """Make the page of a plan: pictures, figures, printability, warnings.

    It shows no computing times, so that the same plan gives the same bytes.

    Args:
        plan: The plan.
        pictures: What `pictures_of` the plan make, where that is known.
    """
    summary = plan.summary
    if pictures is None:
        pictures = map_threads(lambda draw_it: draw_it(), pictures_of(plan))
    sections = [
        row(list(pictures)),
        "<h2>Figures</h2>" + table((), _figures(summary)),
        "<h2>Printability</h2>" + _printability(summary["printability"], summary["collisions"]),
    ]
    if plan.warnings:
        sections.append("<h2>Warnings</h2>" + bullets(plan.warnings))
    lead = (
        f"{summary['layers']} layers of {summary['layer_thickness_mm']:g} mm, "
        f"{summary['engine']} engine"
    )
    return page(str(summary["mesh"]), lead, sections)


def write_plan_page(folder: str | Path, plan: PrintPlan) -> Path:
    """Write `plan.html` into a folder.

    Returns:
        The file's path.

    Raises:
        OutputError: If it cannot be written.
    """
    from vega_planner.results.folder import output_errors

    path = Path(folder) / "plan.html"
    with output_errors(path):
        path.write_bytes(plan_page(plan))
    return path


def pictures_of(plan: PrintPlan) -> tuple[Callable[[], str], ...]:
    """Offer the pictures of the page, each to be drawn by itself."""
    width = float(plan.summary["bead_width_mm"])
    return (
        lambda: figure(_drawn(_part_scene(plan.part)), _part_caption(plan.part)),
        lambda: figure(
            _drawn(layer_scene(plan.stack.sheets, plan.printability.face_reasons)),
            "Layers, cut open; from the first generated (dark) to the last (light)",
        ),
        lambda: figure(
            _drawn(path_scene(plan.toolpaths), 0.4 * width),
            "Toolpath, cut open; in print order from dark to light",
        ),
    )


def _drawn(scene: Scene, line_mm: float = 0.0) -> str:
    return data_uri(draw(scene, View(), line_mm))


def _part_scene(part: Any) -> Scene:
    scene = Scene()
    scene.add_mesh(part.vertices, part.faces[~part.restrained], _PART)
    scene.add_mesh(part.vertices, part.faces[part.restrained], _RESTRAINT)
    return scene


def _part_caption(part: Any) -> str:
    share = part.face_areas[part.restrained].sum() / part.area
    size = " × ".join(f"{value:.1f}" for value in np.ptp(part.bounds, axis=0))
    held = f"; restraint region {100 * share:.0f} % of the surface" if share else ""
    return f"Part, {size} mm{held}"


def layer_scene(layers: tuple[Layer, ...], reasons: tuple[Any, ...] = ()) -> Scene:
    """Lay out the layers, with the quarter nearest to the eye cut away.

    Args:
        layers: Envelopes and cores.
        reasons: Per layer, codes of its faces; those above zero are shown in red.
    """
    scene = Scene()
    lows = [layer.vertices.min(0) for layer in layers if len(layer.vertices)]
    highs = [layer.vertices.max(0) for layer in layers if len(layer.vertices)]
    middle = (np.min(lows, axis=0) + np.max(highs, axis=0)) / 2 if lows else np.zeros(3)
    shades = sequential(np.linspace(0, 1, max(len(layers), 2)))
    flat = bool(layers) and layers[0].kind == "planar"
    for index, layer in enumerate(layers):
        bad = np.zeros(len(layer.faces), bool)
        if index < len(reasons) and len(reasons[index]) == len(layer.faces):
            bad = reasons[index] > 0
        shade = shades[index if not flat else len(layers) - 1 - index]
        for faces, colour in ((layer.faces[~bad], shade), (layer.faces[bad], _UNPRINTABLE)):
            if not len(faces):
                continue
            for vertices, left in _without_quarter(layer.vertices, faces, middle):
                scene.add_mesh(vertices, left, colour)
    return scene


def _without_quarter(
    vertices: Floats, faces: Ints, middle: Floats
) -> Iterator[tuple[Floats, Ints]]:
    """Cut the quarter out that faces the eye of the usual view; what is left, in two pieces."""
    across, along = float(middle[0]), float(middle[1])
    yield clipped(vertices, faces, Cut(0, across, keep_low=True))
    right = clipped(vertices, faces, Cut(0, across, keep_low=False))
    yield clipped(*right, Cut(1, along, keep_low=False))


def _behind(points: Floats, middle: Floats) -> Bools:
    """Points outside the quadrant that faces the eye of the usual view."""
    return ~((points[:, 0] > middle[0]) & (points[:, 1] < middle[1]))


def path_scene(toolpaths: ToolpathSet) -> Scene:
    """Lay out the passes in print order, with the quarter nearest to the eye cut away."""
    scene = Scene()
    total = sum(len(path.points) for path in toolpaths.passes)
    every = 1 + total // _MOST_POINTS
    shades = sequential(np.linspace(0, 1, max(len(toolpaths.passes), 2)))
    blocks, joined, colours = [], [], []
    for path, shade in zip(toolpaths.passes, shades):
        points = np.concatenate([path.points[:-1:every], path.points[-1:]])
        blocks.append(points)
        joined.append(np.arange(len(points)) < len(points) - 1)
        colours.append(np.tile(shade, (len(points), 1)))
    if blocks:
        points, links = np.concatenate(blocks), np.concatenate(joined)[:-1]
        keep = _behind(points, (points.min(0) + points.max(0)) / 2)
        scene.add_lines(points, links & keep[1:] & keep[:-1], np.concatenate(colours))
    return scene


def _figures(summary: dict[str, Any]) -> list[tuple[str, str]]:
    minutes, seconds = divmod(round(summary["print_time_s"]), 60)
    coverage = summary["coverage"]
    figures = [
        ("Print time", f"{minutes} min {seconds:02d} s"),
        ("Path length", f"{summary['path_length_mm'] / 1000:.2f} m"),
        ("Travel", f"{summary['travel_length_mm'] / 1000:.2f} m"),
        ("Material", f"{summary['material_mm3'] / 1000:.2f} ml"),
        ("Volume of the part", f"{summary['volume_mm3'] / 1000:.2f} ml"),
        ("Bead width", f"{summary['bead_width_mm']:g} mm"),
        ("Layer thickness", f"{summary['layer_thickness_mm']:g} mm"),
        ("Not covered", f"{100 * coverage['under_ratio']:.2f} %"),
        ("Covered twice", f"{100 * coverage['over_ratio']:.2f} %"),
        ("Restraint region", " + ".join(summary["brr"]["spec"])),
    ]
    for name in ("robot", "tool", "material"):
        if name in summary:
            figures.append((name.capitalize(), str(summary[name])))
    return figures


def _printability(report: dict[str, Any], collisions: dict[str, Any]) -> str:
    kind, words = _STATUS.get(report["status"], ("bad", report["status"]))
    parts = [
        f'<p><span class="badge {kind}">{text(words)}</span></p>',
        table(
            (),
            [
                ("Reachable", f"{100 * report['reachable_ratio']:.2f} %"),
                ("Accessible", f"{100 * report['accessible_ratio']:.2f} %"),
                ("Free of collisions", f"{100 * report['collision_free_ratio']:.2f} %"),
                ("Layers split", report["split_layers"]),
                ("Colliding waypoints", collisions["colliding_waypoints"]),
            ],
        ),
    ]
    if report["reasons"]:
        rows = [
            (
                reason["code"].replace("_", " "),
                "all" if reason["layer"] < 0 else reason["layer"],
                f"{reason['area_mm2']:.1f}",
                ", ".join(f"{value:.1f}" for value in reason["where_mm"]),
                reason["remedy"],
            )
            for reason in report["reasons"]
        ]
        head = ("What to mind", "layer", "area [mm²]", "where [mm]", "what helps")
        parts.append(table(head, rows))
    return "".join(parts)
