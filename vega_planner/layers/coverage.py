# SPDX-License-Identifier: Apache-2.0
"""How much of a part its layers cover, and how much material is laid in excess."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Floats, Layer, Part
from vega_planner.layers.distance_field import DistanceField
from vega_planner.layers.grid import Grid, inside_states
from vega_planner.layers.grid_kernels import INSIDE

#: Points of the part that are looked at; more change the ratios by less than 0.001.
SAMPLES = 12000

#: Axes of the lattice of these points, aslant of the planes that parts are made of: a
#: lattice along a wall would weigh its depths unevenly.
AXES = np.linalg.qr(np.array([[0.8, -0.51, 0.31], [0.43, 0.83, 0.36], [-0.42, -0.22, 0.88]]))[0]


def coverage_ratios(
    part: Part, grid: Grid, sheets: tuple[Layer, ...], t: float
) -> tuple[float, float]:
    """Compare what the sheets cover with the part.

    A sheet covers what lies within half its local thickness. The overfill is the
    material of all sheets, area times thickness, beyond the inside volume they cover.

    Args:
        part: The part.
        grid: Distances at its nodes.
        sheets: All layers, cores included.
        t: Layer thickness [mm].

    Returns:
        Uncovered volume and overfill, over the part's volume.
    """
    volume = part.volume
    points = inside_points(part, (volume / SAMPLES) ** (1 / 3))
    place = np.rint((points - grid.origin) / grid.spacing).astype(np.int64)
    place = np.clip(place, 0, np.array(grid.shape) - 1)
    node = np.ravel_multi_index(tuple(place.T), grid.shape)
    depth = np.where(grid.state[node] == INSIDE, grid.distance[node], np.nan)
    slack = np.sqrt(0.75) * grid.spacing + 0.05 * t
    covered = np.zeros(len(points), bool)
    material = 0.0
    for sheet in sheets:
        if len(sheet.faces) == 0:
            continue
        local: Floats = sheet.thickness[sheet.faces].mean(1)
        material += float((sheet.face_areas * local).sum())
        candidates = ~covered
        if sheet.kind == "envelope":
            candidates &= ~(np.abs(depth - sheet.depth_mm) > local.max() / 2 + slack)
        rows = np.flatnonzero(candidates)
        if len(rows) == 0:
            continue
        found = DistanceField(sheet.vertices, sheet.faces).nearest(points[rows])
        covered[rows[found.distances <= local[found.faces] / 2 + 1e-6]] = True
    share = float(covered.mean()) if len(covered) else 0.0
    return 1.0 - share, max(0.0, material / volume - share)


def inside_points(part: Part, spacing: float) -> Floats:
    """List the points of a lattice of that spacing [mm] that lie in the part, (n, 3)."""
    turned = np.ascontiguousarray(part.vertices @ AXES)
    low, high = turned.min(0), turned.max(0)
    nx, ny, nz = (int(n) for n in np.ceil((high - low) / spacing) + 2)
    shape = (nx, ny, nz)
    origin = low - 0.37 * spacing
    state = inside_states(turned, part.faces, origin, spacing, shape)
    nodes = np.stack(np.unravel_index(np.flatnonzero(state == INSIDE), shape), axis=1)
    return np.ascontiguousarray((origin + spacing * nodes) @ AXES.T)
