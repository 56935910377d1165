# SPDX-License-Identifier: Apache-2.0
"""How well passes cover what they should: volume, uncovered area, spacing."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from vega_planner.datatypes import Floats, LayerStack, Patch, Toolpath, ToolpathSet, row_lengths
from vega_planner.toolpaths.bead import fill_spacing, section_area
from vega_planner.toolpaths.coverage_kernels import (
    distance_to_segments,
    gaps_beside,
)
from vega_planner.toolpaths.segment_cells import Cells, cells_around

#: Area farther than this from any pass counts as uncovered, in spacings: just over the
#: half that a neighbour covers.
UNCOVERED_RATIO = 0.55

#: Places on the way from one line to the next at which the nearest pass is asked; odd, so
#: that the middle is one.
_ACROSS = 15


def deposited_volume(paths: Iterable[Toolpath]) -> float:
    """Volume of the beads [mm³]: section times length."""
    total = 0.0
    for path in paths:
        area = section_area(path.width, path.height)
        length = row_lengths(np.diff(path.points, axis=0))
        total += float((0.5 * (area[1:] + area[:-1]) * length).sum())
    return total


def volume_to_fill(patch: Patch) -> float:
    """Volume of a patch [mm³]: area times local thickness."""
    return float(patch.face_areas @ patch.thickness[patch.faces].mean(1))


@dataclass(frozen=True, eq=False)
class _Grid:
    """Segments of passes, as starts and ends, in a grid of cells."""

    lines: tuple[Floats, Floats]
    axes: Floats
    cells: Cells

    @classmethod
    def of(cls, paths: Sequence[Toolpath], size: float) -> _Grid:
        a = np.concatenate([path.points[:-1] for path in paths])
        b = np.concatenate([path.points[1:] for path in paths])
        axes = np.concatenate([path.axes[:-1] for path in paths])
        return cls((a, b), axes, cells_around(a, b, size))


def surface_samples(patch: Patch, step: float) -> tuple[Floats, Floats]:
    """Spread points evenly over a patch.

    Args:
        patch: The patch.
        step: Distance between points, about [mm]; infinite for one point a face.

    Returns:
        Positions, shape (k, 3), and the area each stands for [mm²], shape (k,).
    """
    corners = patch.vertices[patch.faces]
    edges = np.max([row_lengths(corners[:, k - 2] - corners[:, k]) for k in range(3)], axis=0)
    parts = np.maximum(1, np.ceil(edges / step)).astype(int)
    points, areas = [], []
    for n in np.unique(parts).tolist():
        chosen = parts == n
        weights = []
        for i in range(n):
            for j in range(n - i):
                weights.append(((i + 1 / 3) / n, (j + 1 / 3) / n))
                if i + j + 1 < n:
                    weights.append(((i + 2 / 3) / n, (j + 2 / 3) / n))
        w = np.array(weights)
        w = np.column_stack([w, 1 - w.sum(1)])
        points.append(np.einsum("kc,fcx->fkx", w, corners[chosen]).reshape(-1, 3))
        areas.append(np.repeat(patch.face_areas[chosen] / len(w), len(w)))
    return np.concatenate(points), np.concatenate(areas)


def uncovered_area(
    patch: Patch, paths: Sequence[Toolpath], reach_mm: float, step_mm: float = np.inf
) -> float:
    """Measure the area of a patch that lies farther than a distance from any pass.

    Args:
        patch: The patch.
        paths: Its passes.
        reach_mm: The distance [mm].
        step_mm: Distance between the points that are asked; one a face when infinite.

    Returns:
        Area [mm²].
    """
    if not paths:
        return patch.area
    points, areas = surface_samples(patch, step_mm)
    grid = _Grid.of(paths, max(1.01 * reach_mm, 0.5))
    a, b = grid.lines
    distance = distance_to_segments(points, a, b, *grid.cells)
    return float(areas[distance > reach_mm].sum())


def pass_gaps(paths: Sequence[Toolpath], spacing_mm: float) -> tuple[Floats, Floats]:
    """Measure the distances between neighbouring lines of the passes of a patch.

    A distance is the width of the bare strip between two lines: straight across from the
    middle of a segment to the line beside it. Where a third line comes between them (the
    end of a pass, the turn of a spiral that leaves its rim) it is twice the largest
    distance from any pass on that way.

    Args:
        paths: The passes.
        spacing_mm: Set spacing [mm]; gaps of more than 1.6 of it are no neighbours.

    Returns:
        Distances over the set spacing, one for each side of each segment that has a
        neighbour there, and the lengths of those segments [mm], both of shape (k,).
    """
    least, most = 0.3 * spacing_mm, 1.6 * spacing_mm
    grid = _Grid.of(paths, most)
    a, b = grid.lines
    gaps, way = gaps_beside(a, b, grid.axes, *grid.cells, least, most)
    length = row_lengths(b - a)
    wide = np.argwhere(gaps > spacing_mm)
    if len(wide):
        row, side = wide.T
        part = (np.arange(_ACROSS) + 0.5) / _ACROSS
        middle = 0.5 * (a[row] + b[row])
        points = middle[:, None] + part[:, None] * way[row, side][:, None]
        near = distance_to_segments(points.reshape(-1, 3), a, b, *grid.cells)
        near = near.reshape(len(wide), _ACROSS)
        gaps[row, side] = np.minimum(gaps[row, side], 2.0 * near.max(1))
    has = gaps > 0
    return gaps[has] / spacing_mm, np.column_stack([length, length])[has]


@dataclass(frozen=True)
class Coverage:
    """How well the passes of a plan fill its layers.

    Attributes:
        under_ratio: Volume that no layer claims or no pass comes near, over the part's.
        over_ratio: Volume claimed twice or deposited beyond what is claimed, over the
            part's.
        deposited_mm3: Volume of the beads.
        claimed_mm3: Volume of the layers.
    """

    under_ratio: float
    over_ratio: float
    deposited_mm3: float
    claimed_mm3: float


def measure_coverage(
    patches: Sequence[Patch], toolpaths: ToolpathSet, stack: LayerStack, width_mm: float
) -> Coverage:
    """Measure how well the passes of a plan fill its layers.

    Args:
        patches: What is printed, in print order.
        toolpaths: The passes; a prime line does not count.
        stack: The layers.
        width_mm: Nominal bead width.
    """
    by_patch: list[list[Toolpath]] = [[] for _ in patches]
    printed = [path for path in toolpaths.passes if path.patch >= 0]
    for path in printed:
        by_patch[path.patch].append(path)
    bare = 0.0
    for patch, paths in zip(patches, by_patch):
        thickness = float(np.median(patch.thickness))
        spacing = fill_spacing(width_mm, thickness)
        bare += thickness * uncovered_area(patch, paths, UNCOVERED_RATIO * spacing)
    volume = max(stack.part.volume, 1e-9)
    claimed = sum(volume_to_fill(patch) for patch in patches)
    deposited = deposited_volume(printed)
    return Coverage(
        under_ratio=stack.uncovered_ratio + bare / volume,
        over_ratio=stack.overfill_ratio + max(0.0, deposited - claimed) / volume,
        deposited_mm3=deposited,
        claimed_mm3=claimed,
    )
