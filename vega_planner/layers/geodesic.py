# SPDX-License-Identifier: Apache-2.0
"""Distance measured inside the part, where the straight way to S leaves it.

The straight way can leave the part only through the restraint region, at a slot or a
hollow. A bead does not act through air, so the distance is then that of the shortest
way inside the part.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vega_planner.datatypes import Floats, Ints, Part
from vega_planner.layers import geodesic_kernels as kernels
from vega_planner.layers.distance_field import DistanceField
from vega_planner.layers.grid import Grid, plane_slabs
from vega_planner.layers.subdivide import mesh_edges
from vega_planner.parallel import map_threads
from vega_planner.progress import Progress, Report

#: Sources stand this far apart along an edge, in grid spacings.
_SOURCE_STEP = 0.3

#: Sources stand this far inside the part, in steps.
_INSET = 0.003

#: Edges that turn by less than this are no corner [rad].
_LEAST_TURN = 0.005


@dataclass(eq=False)
class Sources:
    """What distances are measured from: the triangles of S, then points with a head start.

    Attributes:
        tri: Rows as in `triangle_kernels`; column 12 is the head start [mm].
        rings: Corners, ring starts and rings of all rows.
        box: Box tree over the triangles of S; empty where nearest is not what counts.
    """

    tri: Floats
    rings: tuple[Ints, Ints, Ints]
    box: Floats

    @classmethod
    def straight(cls, field: DistanceField) -> Sources:
        """Measure straight distances."""
        return cls(field.tri, field.rings, field.box)


def is_convex_at_region(part: Part) -> bool:
    """Tell whether the part lies on the inner side of the plane of each restrained face.

    Then every straight way between two of its points crosses no restrained face.
    Sufficient, not necessary, and quick; with many different planes it gives up.
    """
    normals = part.face_normals[part.restrained]
    corners = part.vertices[part.faces[part.restrained][:, 0]]
    planes = np.column_stack([normals, (normals * corners).sum(1)])
    planes = np.unique(np.round(planes, 6), axis=0)
    if len(planes) > 200:
        return False
    size = float(np.ptp(part.vertices, axis=0).max())
    return bool((part.vertices @ planes[:, :3].T - planes[:, 3]).max() < 1e-5 * max(size, 1.0))


def corner_points(part: Part, spacing: float) -> tuple[Floats, Ints]:
    """Spread points over the edges of the restraint region about which the part turns in.

    Returns:
        Points [mm], shape (n, 3), and the edge each stands on, shape (n,).
    """
    edges, sides = mesh_edges(part.faces)
    first = np.full(len(edges), -1)
    second = np.full(len(edges), -1)
    owners = np.repeat(np.arange(len(part.faces)), 3)
    order = np.argsort(sides.ravel(), kind="stable")
    numbers, owners = sides.ravel()[order], owners[order]
    start = np.searchsorted(numbers, np.arange(len(edges)))
    first[:] = owners[start]
    second[:] = owners[np.minimum(start + 1, len(owners) - 1)]
    opposite = part.faces[second].sum(1) - edges.sum(1)
    lift = part.vertices[opposite] - part.vertices[edges[:, 0]]
    height = (part.face_normals[first] * lift).sum(1)
    turn = height / np.maximum(np.linalg.norm(lift, axis=1), 1e-12)
    touches = part.restrained[first] | part.restrained[second]
    # Ways inside bend where the neighbour rises above the face: the part turns inwards.
    chosen = np.flatnonzero(touches & (turn > _LEAST_TURN))
    ends = part.vertices[edges[chosen]]
    # A little inside, so that ways along a face are not taken to touch it.
    inward = -(part.face_normals[first[chosen]] + part.face_normals[second[chosen]])
    inward /= np.maximum(np.linalg.norm(inward, axis=1, keepdims=True), 1e-12)
    ends = ends + _INSET * spacing * inward[:, None, :]
    count = np.maximum(np.ceil(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / spacing), 1)
    count = count.astype(np.int64) + 1
    edge = np.repeat(np.arange(len(chosen)), count)
    place = np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)
    share = (place / (count[edge] - 1))[:, None]
    return ends[edge, 0] * (1 - share) + ends[edge, 1] * share, edge


def bend_distances(
    part: Part, grid: Grid, field: DistanceField, brr: DistanceField, t: float, report: Report
) -> tuple[Sources, float]:
    """Measure the shaded nodes of a grid along ways inside the part.

    Args:
        part: The part.
        grid: Straight distances; changed in place where the straight way is blocked.
        field: Distances to S.
        brr: Distances to the restraint region.
        t: Layer thickness [mm].
        report: Progress.

    Returns:
        The sources, and the share of inside nodes that change layer against straight
        distances.
    """
    nx, ny, nz = grid.shape
    slabs = plane_slabs(nx)
    shaded = np.zeros(len(grid.state), np.uint8)
    blocked = sum(
        map_threads(
            lambda s: kernels.find_blocked(
                field.tri, brr.tri, brr.box, grid.origin, grid.spacing, grid.state, ny, nz, *s,
                grid.slot, shaded,
            ),
            slabs,
        )
    )  # fmt: skip
    inside = int((grid.state == kernels.INSIDE).sum())
    if blocked == 0:
        return Sources.straight(field), 0.0
    sources = _with_corners(part, field, _SOURCE_STEP * grid.spacing)
    first_source = len(field.tri)
    straight = np.floor(grid.distance / t)
    grid.slot[shaded > 0] = -1
    grid.distance[shaded > 0] = 1e30
    near_start, near = _sources_near(sources.tri[first_source:, :3], grid, first_source)
    touched = np.zeros(len(sources.tri) - first_source, np.uint8)

    def sweep(slab: tuple[int, int]) -> int:
        return sum(
            kernels.sweep_inside(
                sources.tri, first_source, near_start, near, brr.tri, brr.box, grid.origin,
                grid.spacing, grid.state, shaded, ny, nz, *slab, backwards,
                grid.distance, grid.slot,
            )
            for backwards in (False, True)
        )  # fmt: skip

    for _ in range(200):
        moved = kernels.relax_sources(
            sources.tri, first_source, brr.tri, brr.box, grid.origin, grid.spacing,
            np.array(grid.shape), grid.state, grid.slot, touched,
        )  # fmt: skip
        changed = sum(map_threads(sweep, slabs[::2])) + sum(map_threads(sweep, slabs[1::2]))
        report(Progress("layers", 0.25))
        if moved == 0 and changed == 0:
            break
    for slab in slabs:
        kernels.extend_ring(
            sources.tri, grid.origin, grid.spacing, grid.state, shaded, ny, nz, *slab,
            grid.distance, grid.slot,
        )  # fmt: skip
    # A node no way leads to belongs to a piece of the part without a surface of S.
    grid.distance[grid.slot < 0] = 0.0
    changed = int(((np.floor(grid.distance / t) != straight) & (shaded > 0)).sum())
    return sources, changed / max(inside, 1)


def _with_corners(part: Part, field: DistanceField, spacing: float) -> Sources:
    """Add points on the corners of the restraint region to the triangles of S."""
    points, edge = corner_points(part, spacing)
    rows = np.zeros((len(points), field.tri.shape[1]))
    rows[:, :3] = points
    rows[:, 12] = 1e30
    corner, start, ring = field.rings
    count, old = len(points), len(field.tri)
    number = np.arange(count)
    before = np.where((number > 0) & (np.roll(edge, 1) == edge), number - 1, number)
    after = np.where((number < count - 1) & (np.roll(edge, -1) == edge), number + 1, number)
    vertex = len(start) - 1 + number
    corner = np.concatenate([corner, np.repeat(vertex[:, None], 3, axis=1)]).astype(np.int32)
    start = np.concatenate([start, start[-1] + 2 * (number + 1)])
    pairs = np.stack([before, after], axis=1).ravel() + old
    ring = np.concatenate([ring, pairs]).astype(np.int32)
    return Sources(np.concatenate([field.tri, rows]), (corner, start, ring), np.zeros((0, 6)))


def _sources_near(points: Floats, grid: Grid, first_source: int) -> tuple[Ints, Ints]:
    """List for each node the sources within two nodes of it along each axis."""
    nx, ny, nz = grid.shape
    base = np.floor((points - grid.origin) / grid.spacing).astype(np.int64)
    nodes, owners = [], []
    for i in range(-1, 3):
        for j in range(-1, 3):
            for k in range(-1, 3):
                place = np.clip(base + np.array([i, j, k]), 0, [nx - 1, ny - 1, nz - 1])
                nodes.append((place[:, 0] * ny + place[:, 1]) * nz + place[:, 2])
                owners.append(np.arange(len(points)) + first_source)
    node, owner = np.concatenate(nodes), np.concatenate(owners)
    order = np.lexsort((owner, node))
    start = np.searchsorted(node[order], np.arange(len(grid.state) + 1))
    return start, owner[order]
