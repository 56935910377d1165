# SPDX-License-Identifier: Apache-2.0
"""The regular grid that samples a part, and the distances at its nodes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from threading import Event
from typing import Any

import numpy as np

from vega_planner.datatypes import Floats, Part
from vega_planner.layers import grid_kernels as kernels
from vega_planner.layers.distance_field import DistanceField
from vega_planner.layers.vertex_kernels import measure_about
from vega_planner.parallel import map_threads
from vega_planner.progress import Progress, Report

#: Slabs of the grid that threads take turns with. Fixed, so that the outcome does not
#: depend on the number of cores; even, so that neighbours are never swept together.
SLABS = 8

#: Nodes this near to one that was found to be wrong at a narrow gap are measured exactly.
GAP_NODES = 3

#: Exact distances are looked up within this many spacings of the surface; the sweeps
#: carry them on from there.
_BAND = 2.5

#: Points answered by one piece of work.
_CHUNK = 512


@dataclass(frozen=True, eq=False)
class Grid:
    """Nodes at origin + h (i, j, k), flat arrays with k running fastest.

    Attributes:
        origin: Position of node (0, 0, 0) [mm].
        spacing: Distance h between neighbours [mm].
        shape: Number of nodes along each axis.
        state: `INSIDE` the part, in the `RING` of nodes around it, or `NONE`, (n,).
        distance: Signed distance to S [mm]; negative beyond S, positive beyond the
            restraint region, (n,).
        slot: Nearest triangle of S, in tree order; -1 where unknown, (n,).
        gradient: Gradient of the distance, (n, 3).
        level: Number of levels below the distance, (n,).
        gap_share: Share of the inside nodes that were beside gaps narrower than the grid.
    """

    origin: Floats
    spacing: float
    shape: tuple[int, int, int]
    state: np.ndarray
    distance: np.ndarray
    slot: np.ndarray
    gradient: np.ndarray
    level: np.ndarray
    gap_share: float = 0.0

    def points(self, nodes: np.ndarray) -> Floats:
        """Positions of nodes [mm], shape (n, 3)."""
        return self.origin + self.spacing * np.stack(np.unravel_index(nodes, self.shape), axis=1)

    @cached_property
    def corner_step(self) -> np.ndarray:
        """Steps from a node to the eight corners of the cell that begins there."""
        _, ny, nz = self.shape
        return np.array([(c & 1) * ny * nz + (c >> 1 & 1) * nz + (c >> 2 & 1) for c in range(8)])

    @cached_property
    def about(self) -> tuple[Any, ...]:
        """What the search for the sheets about a point needs."""
        return (
            self.slot, self.distance, self.gradient, self.origin, self.spacing, self.corner_step
        )  # fmt: skip

    def slabs(self, count: int = SLABS) -> list[tuple[int, int]]:
        """Cut the planes i = 1 .. nx - 2 into slabs (first, last)."""
        return plane_slabs(self.shape[0], count)


def plane_slabs(planes: int, count: int = SLABS) -> list[tuple[int, int]]:
    """Cut planes 1 .. planes - 2 into at most `count` slabs of at least three planes."""
    inner = planes - 2
    count = max(1, min(count, inner // 3))
    cuts = [1 + inner * k // count for k in range(count + 1)]
    return list(pairwise(cuts))


def inside_states(
    vertices: Floats, faces: np.ndarray, origin: Floats, h: float, shape: tuple[int, int, int]
) -> np.ndarray:
    """Mark the nodes inside a closed surface: winding number other than 0.

    Args:
        vertices: Points [mm], shape (n, 3).
        faces: Vertex indices, shape (m, 3).
        origin: Position of node (0, 0, 0) [mm].
        h: Spacing [mm].
        shape: Nodes along each axis.

    Returns:
        `INSIDE` or `NONE` for each node, flat.
    """
    nx, ny, nz = shape
    start = np.zeros(nx * ny + 1, np.int64)
    none = np.zeros(0), np.zeros(0, np.int8)
    kernels.scan_columns(vertices, faces, origin, h, nx, ny, start, *none)
    start = np.cumsum(start)
    height, sign = np.zeros(start[-1]), np.zeros(start[-1], np.int8)
    if start[-1]:
        kernels.scan_columns(vertices, faces, origin, h, nx, ny, start.copy(), height, sign)
    state = np.zeros(nx * ny * nz, np.uint8)
    kernels.mark_inside(start, height, sign, nz, state)
    return state


def sample_part(
    part: Part,
    field: DistanceField,
    h: float,
    report: Report,
) -> Grid:
    """Measure the distance to S at every node in and around the part.

    Args:
        part: The part.
        field: Distances to S.
        h: Spacing [mm].
        report: Progress.

    Returns:
        The grid, its distances unsigned and without levels; see `finish`.
    """
    state, origin, shape = inside_nodes(part, h)
    return sample_nodes(state, origin, h, shape, field, report)


def inside_nodes(part: Part, h: float) -> tuple[np.ndarray, Floats, tuple[int, int, int]]:
    """Lay a grid about a part, and mark the nodes inside.

    Args:
        part: The part.
        h: Spacing [mm].

    Returns:
        `INSIDE` or `NONE` for each node, flat; the position of node (0, 0, 0) [mm], and how
        many nodes there are along each axis.
    """
    low, high = part.bounds
    # Odd offsets keep nodes off the planes that parts are made of.
    origin = low - np.array([2.3717, 2.4143, 2.2831]) * h
    nx, ny, nz = (int(n) for n in np.ceil((high - origin) / h) + 3)
    shape = (nx, ny, nz)
    return inside_states(part.vertices, part.faces, origin, h, shape), origin, shape


def sample_nodes(
    state: np.ndarray,
    origin: Floats,
    h: float,
    shape: tuple[int, int, int],
    field: DistanceField,
    report: Report,
) -> Grid:
    """Measure the distance to S at the inside nodes and the ring around them."""
    nx, ny, nz = shape
    count = nx * ny * nz
    slot = np.full(count, -1, np.int32)
    known = np.zeros((count, 4), np.float32)
    known[:, 0] = kernels.UNKNOWN
    fresh = np.zeros(count, np.uint8)
    slabs = plane_slabs(nx)
    map_threads(lambda s: kernels.mark_ring(state, nx, ny, nz, *s), slabs)
    map_threads(
        lambda s: kernels.start_band(
            field.tri, field.box, origin, h, state, nx, ny, nz, *s, _BAND * h, slot, known, fresh
        ),
        slabs,
    )
    report(Progress("layers", 0.1))

    def sweep(slab: tuple[int, int]) -> int:
        return sum(
            kernels.sweep(
                field.tri, *field.rings, origin, h, ny, nz, *slab, backwards, slot, known, fresh
            )
            for backwards in (False, True)
        )

    def sweep_all() -> None:
        for _ in range(100):
            changed = sum(_in_turn(sweep, slabs))
            report(Progress("layers", 0.2))
            if changed == 0:
                break

    def mend(slab: tuple[int, int]) -> int:
        return int(
            kernels.mend_fronts(
                field.tri, field.box, origin, h, state, ny, nz, *slab, slot, known, fresh
            )
        )

    sweep_all()
    handed = slot.copy()
    mended = sum(_in_turn(mend, slabs))
    if mended:
        sweep_all()
        _measure_about(slot != handed, state, origin, h, shape, field, slot, known)
    distance, gradient = np.zeros(count, np.float32), np.zeros((count, 3), np.float32)
    pieces = [count * k // SLABS for k in range(SLABS + 1)]
    map_threads(lambda s: kernels.part_known(known, *s, distance, gradient), pairwise(pieces))
    gap_share = mended / np.count_nonzero(state == kernels.INSIDE) if mended else 0.0
    level = np.zeros(count, np.int16)
    return Grid(origin, h, shape, state, distance, slot, gradient, level, gap_share)


def _in_turn(work: Callable[[tuple[int, int]], int], slabs: list[tuple[int, int]]) -> list[int]:
    """Work on every other slab, and on each one between as soon as both beside it are done.

    Neighbours never work together, and always in the same turn. What a slab waits for comes
    before it in the order, so that no number of threads keeps it waiting for ever.
    """
    done = [Event() for _ in slabs]

    def turn(k: int) -> int:
        try:
            for beside in (k - 1, k + 1) if k % 2 else ():
                if beside < len(slabs):
                    done[beside].wait()
            return work(slabs[k])
        finally:
            done[k].set()

    order = sorted(range(len(slabs)), key=lambda k: k + 3.5 * (k % 2))
    return map_threads(turn, order)


def _measure_about(
    marked: np.ndarray,
    state: np.ndarray,
    origin: Floats,
    h: float,
    shape: tuple[int, int, int],
    field: DistanceField,
    slot: np.ndarray,
    known: np.ndarray,
) -> None:
    """Measure the inside nodes about marked ones exactly, in place.

    About a gap narrower than the grid no node may hold the nearest triangle of its
    neighbours, so that sweeping does not hand it to them.
    """
    about = marked.reshape(shape)
    for axis in range(3):
        for _ in range(GAP_NODES):
            wider = about.copy()
            ahead, behind = np.moveaxis(wider, axis, 0), np.moveaxis(about, axis, 0)
            ahead[1:] |= behind[:-1]
            ahead[:-1] |= behind[1:]
            about = wider
    nodes = np.flatnonzero(about.ravel() & (state == kernels.INSIDE))
    points = origin + h * np.stack(np.unravel_index(nodes, shape), axis=1)
    exact = field.nearest(points)
    nearer = np.flatnonzero(exact.distances < known[nodes, 0] * (1 - 1e-6))
    nodes, points = nodes[nearer], points[nearer]
    away = exact.distances[nearer, None]
    slot[nodes] = field.slots(exact.faces[nearer])
    known[nodes, 0] = away[:, 0]
    known[nodes, 1:] = (points - exact.points[nearer]) / np.maximum(away, 1e-9)


def finish(
    grid: Grid, tri: Floats, brr: DistanceField | None, r0: float, t: float, bent: bool
) -> None:
    """Sign the distances of a grid, and work out its gradients and levels, in place.

    Args:
        grid: Distances and nearest sources of its nodes.
        tri: Rows of the sources.
        brr: Distances to the restraint region, or None where there is none.
        r0: First level [mm].
        t: Distance between levels [mm].
        bent: Whether distances at inside nodes may have changed since they were sampled.
    """
    nx, ny, nz = grid.shape
    brr_tri = brr.tri if brr else np.zeros((0, 16))
    brr_box = brr.box if brr else np.zeros((1, 6))
    map_threads(
        lambda s: kernels.finish_nodes(
            tri, brr_tri, brr_box, grid.origin, grid.spacing, grid.state, ny, nz, *s, r0, t,
            bent, grid.distance, grid.slot, grid.gradient, grid.level,
        ),
        plane_slabs(nx),
    )  # fmt: skip
    for mark in (kernels.mark_hidden, kernels.mark_bridges):
        _raise_levels(grid, mark, r0, t)


def _raise_levels(grid: Grid, mark: Any, r0: float, t: float) -> None:
    """Count the nodes that a kernel marks as one level deeper."""
    nx, ny, nz = grid.shape
    raised = np.zeros(len(grid.level), np.uint8)
    map_threads(
        lambda s: mark(
            grid.state, grid.distance, grid.gradient, grid.level, grid.spacing, ny, nz, *s, r0, t,
            raised,
        ),
        plane_slabs(nx),
    )  # fmt: skip
    grid.level[raised > 0] += 1


def depths_about(grid: Grid, field: DistanceField, points: Floats) -> Floats:
    """Measure depths of points of the part by what the nodes about them know.

    Args:
        grid: Straight distances at the nodes.
        field: Distances to S.
        points: Points between nodes [mm], shape (n, 3).

    Returns:
        Depths [mm], shape (n,); one may be too large where the surface is bumpy.
    """
    points, count = np.ascontiguousarray(points), len(points)
    depths = np.zeros(count)
    map_threads(
        lambda first: measure_about(
            field.tri, *field.rings, *grid.about, points, first, min(first + _CHUNK, count), depths
        ),
        range(0, count, _CHUNK),
    )
    return depths
