# SPDX-License-Identifier: Apache-2.0
"""All level sets of the distance, as triangle sheets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from vega_planner.datatypes import Floats, Ints
from vega_planner.layers import contour_kernels as kernels
from vega_planner.layers import face_kernels
from vega_planner.layers.contour_tables import component_tables, edge_orders, touching_components
from vega_planner.layers.distance_field import DistanceField
from vega_planner.layers.geodesic import Sources
from vega_planner.layers.grid import Grid
from vega_planner.layers.touching import parted
from vega_planner.parallel import map_threads


@dataclass(frozen=True, eq=False)
class Sheet:
    """The level set {d = r} inside the part.

    Attributes:
        depth: r [mm].
        vertices: Points [mm], shape (n, 3).
        faces: Vertex indices, outward side counter-clockwise, shape (m, 3).
        slots: A triangle of S (tree order) next to each vertex, shape (n,).
        rim: True for vertices on the restraint region, shape (n,).
        inward: Unit vectors away from the nearest point of S, shape (n, 3).
    """

    depth: float
    vertices: Floats
    faces: Ints
    slots: Ints
    rim: np.ndarray
    inward: Floats


def contour_levels(
    grid: Grid, sources: Sources, brr: DistanceField | None, r0: float, t: float
) -> list[Sheet]:
    """Contour the level sets r0 + i t that the grid meets.

    Args:
        grid: Distances at the nodes.
        sources: What distances are measured from.
        brr: Distances to the restraint region, or None where there is none.
        r0: First level [mm].
        t: Distance between levels [mm].

    Returns:
        One sheet for each level from the first to the deepest that is met.
    """
    edges, counts, members = component_tables()
    order, touching = edge_orders(), touching_components()
    _, ny, nz = grid.shape
    corner_step = grid.corner_step
    slabs = grid.slabs(32)
    h, origin, state = grid.spacing, grid.origin, grid.state
    narrow = len(sources.box) == 0
    brr_set: tuple[Any, ...]
    leave = np.full((len(state) if brr else 1, 3), 2.0, np.float32)
    if brr:
        brr_set = (brr.tri, *brr.rings, brr.box)
        map_threads(
            lambda s: kernels.find_exits(
                brr.tri,
                brr.box,
                origin,
                h,
                state,
                grid.distance,
                grid.level,
                narrow,
                ny,
                nz,
                *s,
                leave,
            ),
            slabs,
        )
    else:
        none = np.zeros(0, np.int32)
        brr_set = (
            np.zeros((0, 16)), np.zeros((0, 3), np.int32), np.zeros(1, np.int64), none,
            np.zeros((1, 6)),
        )  # fmt: skip
    base = np.zeros(len(state) + 1, np.int64)
    map_threads(
        lambda s: kernels.count_vertices(grid.level, corner_step, counts, ny, nz, *s, base[1:]),
        slabs,
    )
    np.cumsum(base, out=base)
    total = int(base[-1])
    position = np.zeros((total, 3))
    vertex_level = np.full(total, -1, np.int16)
    vertex_slot = np.zeros(total, np.int32)
    kind = np.zeros(total, np.uint8)
    inward = np.zeros((total, 3))
    source_set: tuple[Any, ...] = (sources.tri, *sources.rings, sources.box)
    make_vertices: Any = kernels.make_vertices
    map_threads(
        lambda s: make_vertices(
            *source_set, *brr_set, origin, h, state, grid.distance, grid.slot, grid.gradient,
            grid.level, leave, r0, t, edges, counts, members, order, touching, corner_step, ny,
            nz, *s, base, position, vertex_level, vertex_slot, kind, inward,
        ),
        slabs,
    )  # fmt: skip
    levels = int(vertex_level.max(initial=-1)) + 1
    used = np.zeros(total, np.uint8)

    def join(slab: tuple[int, int]) -> tuple[Ints, Ints]:
        most = face_kernels.count_crossings(grid.level, state, ny, nz, *slab)
        quads, counts_here = np.zeros((most, 4), np.int64), np.zeros(levels, np.int64)
        count = face_kernels.make_quads(
            sources.tri, origin, h, state, grid.distance, grid.slot, grid.level, leave, r0, t,
            counts, members, corner_step, ny, nz, *slab, base, quads,
        )  # fmt: skip
        faces = np.zeros((2 * count, 3), np.int64)
        face_kernels.split_quads(
            sources.tri, *sources.rings, position, vertex_level, vertex_slot, inward, quads, count,
            r0, t, faces,
        )  # fmt: skip
        face_kernels.count_by_level(vertex_level, faces, used, counts_here)
        return faces, counts_here

    joined = map_threads(join, slabs)
    ends, mine = np.zeros(levels + 1, np.int64), np.zeros(total, np.int64)
    number = np.zeros(total, np.int32)
    face_kernels.number_by_level(vertex_level, used, ends, mine, number)
    # The faces of a level in the order of the slabs.
    face_counts = np.array([counts_here for _, counts_here in joined])
    face_starts = np.cumsum(face_counts.T.ravel()) - face_counts.T.ravel()
    face_ends = np.append(face_starts[:: len(slabs)], face_counts.sum())
    sorted_faces = np.zeros((face_counts.sum(), 3), np.int64)
    map_threads(
        lambda piece: face_kernels.sort_by_level(
            vertex_level, joined[piece][0], number, face_starts[piece :: len(slabs)].copy(),
            sorted_faces,
        ),
        range(len(slabs)),
    )  # fmt: skip
    levels = int(np.searchsorted(ends, ends[-1]))

    def sheet(k: int) -> Sheet:
        rows = mine[ends[k] : ends[k + 1]]
        faces = sorted_faces[face_ends[k] : face_ends[k + 1]]
        marks = kind[rows]
        twice = marks & kernels.TOUCHING > 0
        if twice.any():
            faces, copied = parted(faces, twice)
            rows, marks = np.append(rows, rows[copied]), np.append(marks, marks[copied])
        return Sheet(
            r0 + k * t,
            position[rows],
            faces,
            vertex_slot[rows].astype(np.int64),
            marks & kernels.ON_RIM > 0,
            inward[rows],
        )

    return map_threads(sheet, range(levels))
