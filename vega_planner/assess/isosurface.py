# SPDX-License-Identifier: Apache-2.0
"""Marching cubes with closed, consistently oriented surfaces.

The table of cases is derived, not listed. On each face of a cell the crossed edges are
joined so that two inside nodes at opposite corners stay apart; since the rule knows
only the face's own four nodes, both cells beside it agree and no gap opens. The
segments of the six faces close to loops, and each loop is cut into triangles without
using a chord that lies in a face of the cell, where the neighbour might use it too.

Source:
    Lorensen, Cline: Marching cubes, SIGGRAPH 1987; the face rule is that of Montani,
    Scateni, Scopigno: A modified look-up table, The Visual Computer 10, 1994.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator

import numpy as np

from vega_planner.assess import isosurface_kernels as kernels
from vega_planner.assess.field import Field, Grid
from vega_planner.datatypes import Floats, Ints

Triangles = tuple[tuple[int, int, int], ...]


def extract_surface(field: Field, grid: Grid) -> tuple[Floats, Ints]:
    """Extract the surface where a field changes from inside to outside.

    Args:
        field: Signed field in fixed point; its outermost nodes are all outside.
        grid: Its grid.

    Returns:
        Vertices [mm], shape (n, 3), and faces with normals outward, shape (m, 3): a
        closed mesh.
    """
    counts, table = case_table()
    vertex_count, face_count = kernels.count_crossings(field, counts)
    vertices = np.empty((vertex_count, 3))
    faces = np.empty((face_count, 3), np.int64)
    kernels.march(field, grid.origin, grid.voxel_mm, counts, table, vertices, faces)
    return vertices, faces


@functools.cache
def case_table() -> tuple[Ints, Ints]:
    """Derive the triangles of all 256 cases.

    Returns:
        Number of triangles of each case, shape (256,), and the cell edges of their
        corners, shape (256, most, 3).
    """
    cases = [
        tuple(triangle for loop in _loops(case) for triangle in _cut(loop)) for case in range(256)
    ]
    counts = np.array([len(triangles) for triangles in cases], np.int64)
    table = np.zeros((256, int(counts.max()), 3), np.int64)
    for case, triangles in enumerate(cases):
        table[case, : len(triangles)] = np.reshape(triangles, (-1, 3))
    return counts, table


def _node(x: int, y: int, z: int) -> int:
    return x + 2 * y + 4 * z


@functools.cache
def _edge(a: int, b: int) -> int:
    """Number the edge between two nodes of a cell, as the kernel does."""
    low, axis = min(a, b), {1: 0, 2: 1, 4: 2}[a ^ b]
    x, y, z = low & 1, low >> 1 & 1, low >> 2
    return 4 * axis + ((y + 2 * z), (x + 2 * z), (x + 2 * y))[axis]


@functools.cache
def _face_cycles() -> tuple[tuple[int, ...], ...]:
    """Nodes of the six faces, counter-clockwise seen from outside the cell."""
    cycles = []
    for axis in range(3):
        for side in range(2):
            ring = [(0, 0), (1, 0), (1, 1), (0, 1)]
            nodes = []
            for u, v in ring if side else ring[::-1]:
                place = [0, 0, 0]
                place[axis], place[(axis + 1) % 3], place[(axis + 2) % 3] = side, u, v
                nodes.append(_node(*place))
            cycles.append(tuple(nodes))
    return tuple(cycles)


def _loops(case: int) -> Iterator[tuple[int, ...]]:
    """Chain the segments on the faces of a cell to loops round the inside nodes."""
    following: dict[int, int] = {}
    for cycle in _face_cycles():
        inside = [bool(case >> node & 1) for node in cycle]
        for k in range(4):
            # A run of inside nodes begins at corner k: its segment cuts the run off.
            if inside[k] and not inside[k - 1]:
                end = k
                while inside[(end + 1) % 4]:
                    end += 1
                entry = _edge(cycle[k - 1], cycle[k])
                leave = _edge(cycle[end % 4], cycle[(end + 1) % 4])
                following[entry] = leave
    while following:
        first = min(following)
        loop, edge = [first], following.pop(first)
        while edge != first:
            loop.append(edge)
            edge = following.pop(edge)
        yield tuple(loop)


@functools.cache
def _faces_of_edge(edge: int) -> frozenset[int]:
    return frozenset(
        index
        for index, cycle in enumerate(_face_cycles())
        if any(_edge(cycle[k - 1], cycle[k]) == edge for k in range(4))
    )


def _cut(loop: tuple[int, ...]) -> Triangles:
    """Cut a loop into triangles, with as few chords inside cell faces as possible."""
    return min(_triangulations(loop), key=_flat_chords)


def _triangulations(loop: tuple[int, ...]) -> Iterator[Triangles]:
    if len(loop) < 3:
        yield ()
        return
    first, last = loop[0], loop[-1]
    for k in range(1, len(loop) - 1):
        for left in _triangulations(loop[: k + 1]):
            for right in _triangulations(loop[k:]):
                yield ((first, loop[k], last), *left, *right)


def _flat_chords(triangles: Triangles) -> int:
    """Count chords (edges of two triangles) whose ends lie on one face of the cell."""
    seen: set[tuple[int, int]] = set()
    flat = 0
    for triangle in triangles:
        for k in range(3):
            pair = tuple(sorted((triangle[k - 1], triangle[k])))
            if pair in seen and _faces_of_edge(pair[0]) & _faces_of_edge(pair[1]):
                flat += 1
            seen.add((pair[0], pair[1]))
    return flat
