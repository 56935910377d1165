# SPDX-License-Identifier: Apache-2.0
"""How much of a part its layers cover, and how much material is laid in excess."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vega_planner.datatypes import Floats, Ints, Layer, Part
from vega_planner.layers import coverage_kernels as kernels
from vega_planner.layers.grid import Grid, inside_states
from vega_planner.layers.grid_kernels import INSIDE
from vega_planner.parallel import map_threads

#: Points of the part that are looked at; more change the ratios by less than 0.001.
SAMPLES = 12000

#: Axes of the lattice of these points, aslant of the planes that parts are made of: a
#: lattice along a wall would weigh its depths unevenly.
AXES = np.linalg.qr(np.array([[0.8, -0.51, 0.31], [0.43, 0.83, 0.36], [-0.42, -0.22, 0.88]]))[0]


@dataclass(frozen=True, eq=False)
class Samples:
    """Points spread over a part.

    Attributes:
        points: The points [mm], shape (n, 3).
        depth: Depth at the node next to each [mm], not a number where that is outside.
    """

    points: Floats
    depth: Floats


def spread_samples(part: Part, grid: Grid) -> Samples:
    """Spread points over a part, to be asked which layers cover them."""
    points = inside_points(part, (part.volume / SAMPLES) ** (1 / 3))
    place = np.rint((points - grid.origin) / grid.spacing).astype(np.int64)
    place = np.clip(place, 0, np.array(grid.shape) - 1)
    node = np.ravel_multi_index(tuple(place.T), grid.shape)
    return Samples(points, np.where(grid.state[node] == INSIDE, grid.distance[node], np.nan))


def coverage_ratios(
    part: Part, grid: Grid, samples: Samples, sheets: tuple[Layer, ...], t: float
) -> tuple[float, float]:
    """Compare what the sheets cover with the part.

    A sheet covers what lies within half its local thickness. The overfill is the
    material of all sheets, area times thickness, beyond the inside volume they cover.

    Args:
        part: The part.
        grid: Distances at its nodes.
        samples: Points of the part.
        sheets: All layers, cores included.
        t: Layer thickness [mm].

    Returns:
        Uncovered volume and overfill, over the part's volume.
    """
    volume = part.volume
    points, depth = samples.points, samples.depth
    slack = np.sqrt(0.75) * grid.spacing + 0.05 * t
    envelopes = [sheet for sheet in sheets if sheet.kind == "envelope" and len(sheet.faces)]
    cores = [sheet for sheet in sheets if sheet.kind != "envelope" and len(sheet.faces)]

    def cover(sheet: Layer) -> tuple[Ints, float]:
        near = ~(np.abs(depth - sheet.depth_mm) > sheet.thickness.max() / 2 + slack)
        return covered_rows(sheet, points, np.flatnonzero(near))

    covered = np.zeros(len(points), bool)
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


def inside_points(part: Part, spacing: float) -> Floats:
    """List the points of a lattice of that spacing [mm] that lie in the part, (n, 3)."""
    turned = np.ascontiguousarray(part.vertices @ AXES)
    low, high = turned.min(0), turned.max(0)
    across, along, up = (int(n) for n in np.ceil((high - low) / spacing) + 2)
    shape = (across, along, up)
    origin = low - 0.37 * spacing
    state = inside_states(turned, part.faces, origin, spacing, shape)
    nodes = np.stack(np.unravel_index(np.flatnonzero(state == INSIDE), shape), axis=1)
    return np.ascontiguousarray((origin + spacing * nodes) @ AXES.T)


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
