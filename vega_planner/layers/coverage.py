# SPDX-License-Identifier: Apache-2.0
"""How much of a part its layers cover, and how much material is laid in excess."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Floats, Layer
from vega_planner.layers.distance_field import DistanceField
from vega_planner.layers.grid import Grid
from vega_planner.layers.grid_kernels import INSIDE

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
    covered = np.zeros(len(nodes), bool)
    material = 0.0
    for sheet in sheets:
        if len(sheet.faces) == 0:
            continue
        local: Floats = sheet.thickness[sheet.faces].mean(1)
        material += float((sheet.face_areas * local).sum())
        open_nodes = ~covered
        if sheet.kind == "envelope":
            open_nodes &= np.abs(depth - sheet.depth_mm) < local.max() / 2 + 0.05 * t
        rows = np.flatnonzero(open_nodes)
        if len(rows) == 0:
            continue
        found = DistanceField(sheet.vertices, sheet.faces).nearest(points[rows])
        covered[rows[found.distances <= local[found.faces] / 2 + 1e-6]] = True
    share = float(covered.mean()) if len(covered) else 0.0
    return 1.0 - share, max(0.0, material / volume - share)
