# SPDX-License-Identifier: Apache-2.0
"""Passes in short stretches: which keep the nozzle from which, and what each lies on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vega_planner.datatypes import Bools, Floats, Ints, Toolpath
from vega_planner.parallel import cores, map_threads
from vega_planner.printability.material import EMPTY, DistanceField
from vega_planner.printability.tool_kernels import tool_hits
from vega_planner.printability.tool_shape import STEP_MM, ToolShape, tip_length
from vega_planner.printability.turning import arc_length

if TYPE_CHECKING:
    from vega_planner.robot.workcell import Workcell

#: Length of the stretches, in bead widths, and most of them.
STRETCH_WIDTHS, MOST_STRETCHES = 2.0, 5000

#: Distance of the places along the beads that are looked at [mm], and most of them.
STATION_MM, MOST_STATIONS = 1.0, 15_000

#: Half of a bead, in layer thicknesses, across the tool and along it: places stand for it.
HALF_ACROSS, HALF_ALONG = 0.7, 0.4

#: A bead lies on those whose middles are within this of the place one bead behind it, seen
#: from the nozzle, or below it, in bead widths; and one bead on a wall below the other is
#: this far from it, as beads overlap.
REACH_WIDTHS, STEP_WIDTHS = 0.6, 0.85

#: A bead lies on the ground if the place one bead behind or below is this near, in bead
#: heights: that of the second layer is half a bead above it.
ON_GROUND = 0.25

#: Where nothing is there, a bead still holds to one within this, in bead widths, whose
#: middle is this much lower, in layer thicknesses: the next one on an overhang.
TOUCH_WIDTHS, LOWER_LAYERS = 1.1, 0.25


@dataclass(frozen=True)
class Stretch:
    """Part of a pass: number of the pass, first and last row."""

    number: int
    first: int
    last: int


@dataclass(frozen=True, eq=False)
class Stations:
    """Places along the passes, by stretch.

    Attributes:
        points: Positions [mm], shape (n, 3).
        axes: Unit tool axes, shape (n, 3).
        height: Height of the bead [mm], shape (n,).
        width: Its width [mm], shape (n,).
        stretch: Stretch each belongs to, rising, shape (n,).
        area: Area of the layer each stands for [mm²], shape (n,).
    """

    points: Floats
    axes: Floats
    height: Floats
    width: Floats
    stretch: Ints
    area: Floats


def stretches_of(passes: Sequence[Toolpath]) -> list[Stretch]:
    """Cut passes into stretches of about the same length; neighbours share a row."""
    widths = np.concatenate([path.width for path in passes])
    total = sum(path.length_mm for path in passes)
    wanted = max(STRETCH_WIDTHS * float(np.median(widths)), total / MOST_STRETCHES)
    found = []
    for number, path in enumerate(passes):
        along = arc_length(path.points)
        count = max(1, round(float(along[-1]) / wanted))
        cuts = np.searchsorted(along, np.linspace(0.0, along[-1], count + 1)[1:-1])
        edges = sorted({0, *(int(cut) for cut in cuts), len(along) - 1})
        found += [Stretch(number, first, last) for first, last in pairwise(edges)]
    return found


def stations_of(passes: Sequence[Toolpath], stretches: Sequence[Stretch]) -> Stations:
    """Spread places evenly along the stretches, at least two on each."""
    step = max(STATION_MM, sum(path.length_mm for path in passes) / MOST_STATIONS)
    parts = []
    for index, stretch in enumerate(stretches):
        path, run = passes[stretch.number], slice(stretch.first, stretch.last + 1)
        rows = np.column_stack([path.points, path.axes, path.height, path.width])[run]
        along = arc_length(path.points[run])
        count = max(2, round(float(along[-1]) / step))
        at = (np.arange(count) + 0.5) / count * along[-1]
        columns = [np.interp(at, along, column) for column in rows.T]
        area = columns[-1] * along[-1] / count
        parts.append(np.column_stack([*columns, np.full(count, float(index)), area]))
    rows = np.concatenate(parts)
    return Stations(
        points=np.ascontiguousarray(rows[:, :3]),
        axes=rows[:, 3:6] / np.linalg.norm(rows[:, 3:6], axis=1, keepdims=True),
        height=rows[:, 6],
        width=rows[:, 7],
        stretch=rows[:, 8].astype(np.int64),
        area=rows[:, 9],
    )


def blocked_poses(
    stations: Stations, count: int, cell: Workcell, thickness_mm: float
) -> NDArray[np.float32]:
    """Count the poses of a stretch whose tool would meet another stretch.

    Args:
        stations: Places along the stretches.
        count: Number of stretches n.
        cell: The tool.
        thickness_mm: Nominal thickness of the layers.

    Returns:
        blocked[a, b]: poses of a that meet b, shape (n, n).
    """
    height = float(np.median(stations.height))
    start = tip_length(thickness_mm) - HALF_ALONG * height
    tool = ToolShape.of(cell.tool, start)
    hits = np.zeros((count, count), np.int64)
    # each thread counts for stretches of its own
    cuts = np.linspace(0, count, 4 * cores() + 1).astype(int)
    edges = np.searchsorted(stations.stretch, cuts)

    def count_hits(piece: tuple[int, int]) -> None:
        run = slice(*piece)
        tool_hits(
            stations.points[run], stations.axes[run], stations.stretch[run], stations.points,
            stations.stretch, tool.start_mm, STEP_MM, tool.samples, HALF_ACROSS * height, hits,
        )  # fmt: skip

    map_threads(count_hits, [(int(a), int(b)) for a, b in pairwise(edges)])
    np.fill_diagonal(hits, 0)
    return hits.astype(np.float32)


@dataclass(frozen=True, eq=False)
class Holding:
    """What the stations lie on.

    Attributes:
        held: Stations that wait for nothing: on the plate, the substrate or, at worst, on
            nothing that there will ever be, shape (n,).
        loose: Those of them with nothing to hold to, shape (n,).
        carried: Per stretch, the stations of others that lie on it.
    """

    held: Bools
    loose: Bools
    carried: tuple[Ints, ...]


def what_holds(
    stations: Stations, count: int, surroundings: DistanceField, plate_z_mm: float
) -> Holding:
    """Find what lies behind each station, seen from the nozzle, and below it.

    Args:
        stations: Places along the stretches.
        count: Number of stretches.
        surroundings: Distance field of the substrate.
        plate_z_mm: Height of the plate.
    """
    from scipy.spatial import cKDTree

    height = stations.height
    below = stations.points.copy()
    rise = stations.axes[:, 2]
    across = STEP_WIDTHS * stations.width * np.sqrt(np.maximum(1.0 - rise**2, 0.0))
    below[:, 2] -= np.hypot(across, rise * height)
    places = (stations.points - height[:, None] * stations.axes, below)
    ground = np.zeros(len(height), np.bool_)
    tree = cKDTree(stations.points)
    lies: list[Ints] = []
    on: list[Ints] = []
    for at in places:
        ground |= at[:, 2] <= plate_z_mm + ON_GROUND * height
        if surroundings is not EMPTY:
            ground |= surroundings.distance(at) <= ON_GROUND * height
        near = tree.query_ball_point(at, REACH_WIDTHS * stations.width)
        lies.append(np.repeat(np.arange(len(at)), [len(found) for found in near]))
        on.append(stations.stretch[np.array([k for found in near for k in found], np.int64)])
    pairs = np.column_stack([np.concatenate(on), np.concatenate(lies)])
    pairs = np.unique(pairs[pairs[:, 0] != stations.stretch[pairs[:, 1]]], axis=0)
    edges = np.searchsorted(pairs[:, 0], np.arange(count + 1))
    carried = tuple(pairs[a:b, 1] for a, b in pairwise(edges))
    loose = ~ground
    loose[pairs[:, 1]] = False
    alone = np.flatnonzero(loose)
    near = tree.query_ball_point(stations.points[alone], TOUCH_WIDTHS * stations.width[alone])
    heights = stations.points[:, 2]
    lower = heights[alone] - LOWER_LAYERS * height[alone]
    loose[alone] = [heights[found].min() > most for found, most in zip(near, lower)]
    held = ground.copy()
    held[alone] = True
    return Holding(held, loose, carried)
