# SPDX-License-Identifier: Apache-2.0
"""Measure the layers of many parts: quality first, then seconds and memory.

    python bench/layers.py [--parts NAME,NAME] [--engine field] [--json FILE] [--meshes DIR]
    python bench/layers.py --costs [--report FILE]

Every figure is worked out here from the layers as they come out, with nothing of the
engine but the public nearest-point query.
"""

from __future__ import annotations

import argparse
import json
import resource
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from vega_planner.datatypes import Layer, LayerStack, Part
from vega_planner.layers import generate_layers
from vega_planner.layers.distance_field import DistanceField
from vega_planner.settings import LayerSettings

sys.path.insert(0, str(Path(__file__).parent))
from layer_parts import DEPTHS, PARTS, blob, mesh_parts


def measure(part: Part, settings: LayerSettings | None = None, repeats: int = 3) -> dict[str, Any]:
    """Generate the layers of a part and measure them.

    Args:
        part: The part.
        settings: Layer settings; the defaults if absent.
        repeats: How often to time the generation; the median counts.

    Returns:
        Plain numbers, ready for JSON. Lengths in mm, ratios of the part's volume.
    """
    settings = settings or LayerSettings()
    seconds = []
    cpu = []
    for _ in range(repeats):
        start, cpu_start = time.perf_counter(), time.process_time()
        stack = generate_layers(part, settings)
        seconds.append(time.perf_counter() - start)
        cpu.append(time.process_time() - cpu_start)
    row: dict[str, Any] = {
        "part": part.name,
        "faces": len(part.faces),
        "layers": len(stack.layers),
    }
    row |= depth_errors(stack) | topology(stack) | completeness(stack) | filling(stack)
    row |= {
        "reported_uncovered_ratio": stack.uncovered_ratio,
        "reported_overfill_ratio": stack.overfill_ratio,
        "cores": len(stack.cores),
        "layer_faces": sum(len(layer.faces) for layer in stack.layers),
        "warnings": list(stack.warnings),
        "seconds": float(np.median(seconds)),
        "cpu_seconds": float(np.median(cpu)),
        "peak_memory_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
    }
    return row


def depth_errors(stack: LayerStack) -> dict[str, float]:
    """Compare depth with the distance to S inside the part, and look outside the part."""
    part = stack.part
    depths = DEPTHS.get(part.name, DistanceField.of_part(part).distances)
    whole = DistanceField(part.vertices, part.faces)
    region = None
    if part.restrained.any():
        region = DistanceField(part.vertices, part.faces[part.restrained])
    at_vertices, at_centres = [np.zeros(1)], [np.zeros(1)]
    outside, rims = [0.0], [np.zeros(1)]
    for layer in stack.layers:
        if len(layer.faces) == 0:
            continue
        centres = layer.vertices[layer.faces].mean(1)
        at_vertices.append(np.abs(depths(layer.vertices) - layer.depth_mm))
        at_centres.append(np.abs(depths(centres) - layer.depth_mm))
        points = np.concatenate([layer.vertices, centres])
        near = whole.nearest(points)
        side = ((points - near.points) * part.face_normals[near.faces]).sum(1)
        # Layers lie deeper than S, so they could only leave through the region.
        leaves = (side > 0) & part.restrained[near.faces]
        outside.append(float(near.distances[leaves].max(initial=0.0)))
        rim = rim_vertices(layer)
        if len(rim) and region is not None:
            rims.append(region.distances(layer.vertices[rim]))
        elif len(rim):
            rims.append(np.full(1, np.inf))
    vertices, centres = np.concatenate(at_vertices), np.concatenate(at_centres)
    both = np.concatenate([vertices, centres])
    return {
        "depth_p99": float(np.quantile(both, 0.99)),
        "depth_vertex_max": float(vertices.max()),
        "depth_centre_max": float(centres.max()),
        "outside_max": max(outside),
        "rim_max": float(np.concatenate(rims).max()),
    }


def sheet_edges(layer: Layer) -> tuple[np.ndarray, np.ndarray]:
    """List the edges of a sheet and how many faces use each."""
    edges = np.sort(layer.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    return np.unique(edges, axis=0, return_counts=True)


def rim_vertices(layer: Layer) -> np.ndarray:
    """List the vertices on open edges."""
    edges, uses = sheet_edges(layer)
    return np.unique(edges[uses == 1])


def topology(stack: LayerStack) -> dict[str, float]:
    """Count what upsets the next stage: non-manifold edges and slivers."""
    shared, slivers, total = 0, 0, 0
    for layer in stack.sheets:
        if len(layer.faces) == 0:
            continue
        shared += int((sheet_edges(layer)[1] > 2).sum())
        corners = layer.vertices[layer.faces]
        sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
        height = 2 * layer.face_areas / np.maximum(sides.max(1), 1e-30)
        slivers += int((height < 0.01 * stack.thickness_mm).sum())
        total += len(layer.faces)
    return {"nonmanifold_edges": shared, "sliver_ratio": slivers / max(total, 1)}


def inside_points(part: Part, count: int, margin: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Spread points evenly over the bounding box, in columns; tell which are inside."""
    rng = np.random.default_rng(0)
    low, high = part.bounds
    each = 10 if len(part.faces) < 30000 else 100
    # Columns follow Roberts' R2 sequence, heights are drawn one to an equal share.
    turns = np.outer(np.arange(count // each), [0.7548776662466927, 0.5698402909980532]) % 1
    columns = low[:2] - margin + turns * (high - low + 2 * margin)[:2]
    heights = (np.arange(each) + rng.random((len(columns), each))) / each
    heights = low[2] - margin + heights * (high - low + 2 * margin)[2]
    corners = part.vertices[part.faces]
    flat = corners[:, :, :2]
    span = flat.min(1), flat.max(1)
    winding = np.zeros(heights.shape, np.int64)
    for k, column in enumerate(columns):
        hit = np.flatnonzero(((span[0] <= column) & (span[1] >= column)).all(1))
        a, b, c = (flat[hit, n] - column for n in range(3))
        wa, wb, wc = (p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0] for p, q in ((b, c), (c, a), (a, b)))
        up, down = (wa > 0) & (wb > 0) & (wc > 0), (wa < 0) & (wb < 0) & (wc < 0)
        area = np.where(up | down, wa + wb + wc, 1.0)
        z = (np.stack([wa, wb, wc], 1) * corners[hit, :, 2]).sum(1) / area
        above = z[:, None] > heights[k]
        winding[k] = (above & up[:, None]).sum(0) - (above & down[:, None]).sum(0)
    points = np.column_stack([np.repeat(columns, each, axis=0), heights.ravel()])
    return points, winding.ravel() != 0


def completeness(stack: LayerStack, count: int = 60000) -> dict[str, float]:
    """Find points of the level sets that no sheet passes by.

    A random inside point at least 0.25 mm deeper than a level is moved back along its
    gradient to that level, where the sheet must be; pieces narrower than 0.5 mm are not
    sampled. Sheets of the core count as well, within half their thickness.
    """
    part, t = stack.part, stack.thickness_mm
    points, inside = inside_points(part, count)
    points = points[inside]
    field = DistanceField.of_part(part)
    if part.name in DEPTHS:
        # Only where the straight way stays inside is the gradient known.
        points = points[np.abs(DEPTHS[part.name](points) - field.distances(points)) < 1e-6]
    found = field.nearest(points)
    missing, asked = 0, 0
    cores = [DistanceField(core.vertices, core.faces) for core in stack.cores]
    deepest = int(np.floor((found.distances.max() - 0.25 - t / 2) / t + 1e-9)) + 1
    for level in range(deepest):
        r = t / 2 + level * t
        # The last few levels below each point: pieces about to close.
        deep = (found.distances > r + 0.25) & (found.distances < r + 2 * t)
        if not deep.any():
            continue
        ray = (points[deep] - found.points[deep]) / found.distances[deep][:, None]
        on_level = found.points[deep] + r * ray
        asked += len(on_level)
        gap = np.full(len(on_level), np.inf)
        if level < len(stack.layers) and len(stack.layers[level].faces):
            layer = stack.layers[level]
            gap = DistanceField(layer.vertices, layer.faces).distances(on_level)
        for core in cores:
            gap = np.minimum(gap, np.maximum(core.distances(on_level) - 0.75 * t, 0))
        missing += int((gap > 0.2).sum())
    return {"missing_ratio": missing / max(asked, 1), "expected_layers_at_least": deepest}


def filling(stack: LayerStack, count: int = 200000) -> dict[str, float]:
    """Measure the volume no layer covers, and the material laid beyond what fits.

    A sheet covers what lies within half its local thickness. The overfill is the
    material of all sheets (area times thickness) less the inside volume they cover.
    """
    part = stack.part
    points, inside = inside_points(part, count, stack.thickness_mm / 2)
    points = points[inside]
    covered = np.zeros(len(points), bool)
    claims = np.zeros(len(points), np.int64)
    depth = DistanceField.of_part(part).distances(points)
    material = 0.0
    occluded = any("restraint region" in warning for warning in stack.warnings)
    for sheet in stack.sheets:
        if len(sheet.faces) == 0:
            continue
        local = sheet.thickness[sheet.faces].mean(1)
        material += float((sheet.face_areas * local).sum())
        near = np.ones(len(points), bool)
        if sheet.kind == "envelope" and not occluded:
            near = np.abs(depth - sheet.depth_mm) < 0.51 * local.max() + 0.1
        candidates = np.flatnonzero(near)
        if len(candidates) == 0:
            continue
        found = DistanceField(sheet.vertices, sheet.faces).nearest(points[candidates])
        hit = candidates[found.distances <= local[found.faces] / 2 * 1.0001]
        covered[hit] = True
        claims[hit] += 1
    volume = part.volume
    return {
        "uncovered_ratio": float(1 - covered.mean()),
        "overfill_ratio": float(material / volume - covered.mean()),
        "claimed_twice_ratio": float(np.maximum(claims - 1, 0).mean()),
    }


#: Sizes [mm] and triangles of the cost table, about.
SIZES = (20, 50, 100, 200)
TRIANGLES = (1280, 20480, 81920, 1310720)


def cost(case: tuple[int, int]) -> dict[str, Any]:
    """Measure a bumpy part of a size and number of triangles; call it in a new process.

    Returns:
        Seconds and processor seconds, the best of three up to 100 mm, and the peak memory
        of the process over what it had before, and in all [MB].
    """
    size, faces = case
    generate_layers(PARTS["dome"](), LayerSettings())
    part = blob(size, faces)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    took = []
    for _ in range(3 if size <= 100 else 1):
        start, cpu_start = time.perf_counter(), time.process_time()
        stack = generate_layers(part, LayerSettings())
        took.append((time.perf_counter() - start, time.process_time() - cpu_start))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {
        "size_mm": size,
        "faces": len(part.faces),
        "layers": len(stack.layers),
        "layer_faces": sum(len(layer.faces) for layer in stack.layers),
        "seconds": min(took)[0],
        "cpu_seconds": min(cpu for _, cpu in took),
        "before_mb": before,
        "peak_memory_mb": peak,
    }


def costs() -> list[dict[str, Any]]:
    """Measure all cases of the cost table, each in a process of its own."""
    rows = []
    for case in product(SIZES, TRIANGLES):
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
            rows.append(pool.submit(cost, case).result())
        print("  ".join(f"{k} {v:.4g}" for k, v in rows[-1].items()), flush=True)
    return rows


def in_words(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4f}" if abs(value) < 1 else f"{value:.4g}"
    return str(value)


def markdown(rows: list[dict[str, Any]]) -> str:
    """Lay out rows of figures as a table."""
    names = [name for name in rows[0] if name != "warnings"]
    lines = [" | ".join(names), " | ".join("---" for _ in names)]
    lines += [" | ".join(in_words(row[name]) for name in names) for row in rows]
    return "\n".join(f"| {line} |" for line in lines) + "\n"


COLUMNS = (
    ("part", "s"),
    ("faces", "d"),
    ("layers", "d"),
    ("depth_p99", ".4f"),
    ("depth_vertex_max", ".3f"),
    ("depth_centre_max", ".3f"),
    ("outside_max", ".4f"),
    ("rim_max", ".4f"),
    ("nonmanifold_edges", "d"),
    ("sliver_ratio", ".4f"),
    ("missing_ratio", ".4f"),
    ("uncovered_ratio", ".4f"),
    ("overfill_ratio", ".4f"),
    ("claimed_twice_ratio", ".4f"),
    ("cores", "d"),
    ("seconds", ".2f"),
    ("cpu_seconds", ".2f"),
    ("peak_memory_mb", ".0f"),
)


def main() -> None:
    """Measure the named parts and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--parts", default="", help="names, comma-separated; all if absent")
    parser.add_argument("--engine", default="field")
    parser.add_argument("--thickness", type=float, default=0.8)
    parser.add_argument("--json", default="", help="file to write the rows to")
    parser.add_argument("--meshes", default="", help="folder of meshes to measure as well")
    parser.add_argument("--costs", action="store_true", help="print the cost table instead")
    parser.add_argument("--report", default="", help="file to write the table to, as Markdown")
    parser.add_argument("--repeats", type=int, default=3)
    options = parser.parse_args()
    if options.costs:
        table = markdown(costs())
        if options.report:
            Path(options.report).write_text(table, encoding="utf-8")
        return
    makers = dict(PARTS)
    if options.meshes:
        makers |= mesh_parts(Path(options.meshes))
    names = options.parts.split(",") if options.parts else list(makers)
    settings = LayerSettings(thickness_mm=options.thickness, engine=options.engine)
    print("  ".join(name for name, _ in COLUMNS))
    rows = []
    for name in names:
        row = measure(makers[name](), settings, options.repeats)
        rows.append(row)
        print("  ".join(f"{row[key]:{style}}" for key, style in COLUMNS), flush=True)
        for warning in row["warnings"]:
            print("   ", warning)
    if options.report:
        kept = [{name: row[name] for name, _ in COLUMNS} for row in rows]
        Path(options.report).write_text(markdown(kept), encoding="utf-8")
    if options.json:
        Path(options.json).write_text(json.dumps(rows, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
