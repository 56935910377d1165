# SPDX-License-Identifier: Apache-2.0
"""How much of a part its layers cover, and how much material is laid in excess."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Floats, Ints, Layer
from vega_planner.layers import coverage_kernels as kernels
from vega_planner.layers.grid import Grid
from vega_planner.layers.grid_kernels import INSIDE
from vega_planner.parallel import map_threads

#: Nodes of the grid that are looked at; more change the ratios by less than 0.001.
SAMPLES = 12000


def coverage_ratios(
    grid: Grid, sheets: tuple[Layer, ...], t: float, volume: float
) -> tuple[float, float]:
    """Compare what the sheets cover with the part.

    A sheet covers what lies within half its local thickness. The overfill is the
    material of all sheets, area times thickness, beyond the inside volume they cover.

    Args:
        grid: Nodes of the part.
        sheets: All layers, cores included.
        t: Layer thickness [mm].
        volume: Volume of the part [mm³].

    Returns:
        Uncovered volume and overfill, over the part's volume.
    """
    nodes = np.flatnonzero(grid.state == INSIDE)
    # A stride prime to the grid's rows takes an even share of all places.
    stride = max(1, len(nodes) // SAMPLES) | 1
    nodes = nodes[::stride]
    points = grid.points(nodes)
    depth = grid.distance[nodes].astype(np.float64)
    envelopes = [sheet for sheet in sheets if sheet.kind == "envelope" and len(sheet.faces)]
    cores = [sheet for sheet in sheets if sheet.kind != "envelope" and len(sheet.faces)]

    def cover(sheet: Layer) -> tuple[Ints, float]:
        near = np.abs(depth - sheet.depth_mm) < sheet.thickness.max() / 2 + 0.05 * t
        return covered_rows(sheet, points, np.flatnonzero(near))

    covered = np.zeros(len(nodes), bool)
    material = 0.0
    for rows, laid in map_threads(cover, envelopes):
        covered[rows] = True
        material += laid
    missed = np.flatnonzero(~covered)
    for rows, laid in map_threads(lambda sheet: covered_rows(sheet, points, missed), cores):
        covered[rows] = True
        material += laid
    share = float(covered.mean()) if len(covered) else 0.0
    return 1.0 - share, max(0.0, material / volume - share)


def covered_rows(sheet: Layer, points: Floats, rows: Ints) -> tuple[Ints, float]:
    """Find the points that a sheet covers.

    Args:
        sheet: A sheet with faces.
        points: Points [mm], shape (n, 3).
        rows: The points to look at.

    Returns:
        Those of `rows` that lie within half the local thickness of a face, and the
        material of the sheet, area times thickness [mm³].
    """
    count = len(sheet.faces)
    middle, half = np.zeros((count, 3)), np.zeros(count)
    material, reach = kernels.weigh_faces(
        sheet.vertices, sheet.faces, sheet.thickness, middle, half
    )
    low = middle.min(0)
    beside = (points[rows] > low - reach) & (points[rows] < middle.max(0) + reach)
    rows = rows[beside.all(1)]
    shape = ((middle.max(0) - low) / reach).astype(np.int64) + 1
    start, order = np.zeros(int(shape.prod()) + 1, np.int64), np.zeros(count, np.int32)
    kernels.sort_faces(middle, low, reach, shape, start, order)
    out = np.zeros(len(rows), np.bool_)
    kernels.mark_covered(
        sheet.vertices, sheet.faces, half, low, reach, shape, start, order, points[rows], out
    )
    return rows[out], float(material)
