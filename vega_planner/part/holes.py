# SPDX-License-Identifier: Apache-2.0
"""Closing holes: rims of missing faces are spanned by triangles of least area."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vega_planner.datatypes import Floats, Ints, face_cross
from vega_planner.part.topology import directed_edges, edge_uses

#: Rims with more vertices are spanned in their mean plane: least area is O(n³).
LONGEST_EXACT = 220


@dataclass(frozen=True)
class Filling:
    """What was put into holes.

    Attributes:
        faces: New faces, shape (k, 3).
        holes: Number of rims that were spanned.
        area_mm2: Area of the new faces.
        widest_mm: Largest extent of one rim.
    """

    faces: Ints
    holes: int
    area_mm2: float
    widest_mm: float


def fill_holes(vertices: Floats, faces: Ints) -> Filling:
    """Span every rim of an oriented mesh with triangles between its vertices.

    Args:
        vertices: Points [mm], shape (n, 3).
        faces: Vertex indices, shape (m, 3).

    Returns:
        The new faces and how much they are.
    """
    loops = rim_loops(faces)
    patches = [span_rim(vertices, loop) for loop in loops]
    new = np.concatenate(patches) if patches else np.zeros((0, 3), dtype=np.int64)
    area = 0.5 * float(np.linalg.norm(face_cross(vertices, new), axis=1).sum())
    widest = max((float(np.ptp(vertices[loop], axis=0).max()) for loop in loops), default=0.0)
    return Filling(new, len(loops), area, widest)


def rim_loops(faces: Ints) -> list[Ints]:
    """Trace the rims of a mesh, each in the direction that new faces run along it.

    A rim that passes a vertex twice is taken apart there.

    Args:
        faces: Vertex indices of an oriented mesh, shape (m, 3).

    Returns:
        Vertex indices of each closed rim.
    """
    order, starts, uses = edge_uses(faces)
    rim = directed_edges(faces)[np.sort(order[starts[uses == 1]])][:, ::-1]
    onward: dict[int, list[int]] = {}
    for start, end in rim.tolist():
        onward.setdefault(start, []).append(end)
    loops = []
    for start in list(onward):
        while onward.get(start):
            chain, place = [start], {start: 0}
            while onward.get(chain[-1]):
                step = onward[chain[-1]].pop(0)
                if step in place:
                    loop = chain[place[step] :]
                    if len(loop) > 2:
                        loops.append(np.array(loop))
                    for vertex in chain[place[step] + 1 :]:
                        del place[vertex]
                    chain = chain[: place[step] + 1]
                else:
                    place[step] = len(chain)
                    chain.append(step)
    return loops


def span_rim(vertices: Floats, loop: Ints) -> Ints:
    """Span one rim with triangles between its vertices.

    Args:
        vertices: Points [mm], shape (n, 3).
        loop: Vertex indices of the rim, in the direction that faces run along it.

    Returns:
        New faces, shape (k, 3).
    """
    if len(loop) <= LONGEST_EXACT:
        return loop[_least_area(vertices[loop])]
    return loop[_in_mean_plane(vertices[loop])]


def _least_area(points: Floats) -> Ints:
    """Triangulate a polygon in space with least area by dynamic programming.

    Source:
        [BarequetSharir1995]_.
    """
    count = len(points)
    cost = np.zeros((count, count))
    choice = np.zeros((count, count), dtype=np.int64)
    for gap in range(2, count):
        for i in range(count - gap):
            j = i + gap
            middle = np.arange(i + 1, j)
            sides = np.cross(points[middle] - points[i], points[j] - points[i])
            total = cost[i, middle] + cost[middle, j] + np.linalg.norm(sides, axis=1)
            best = int(np.argmin(total))
            cost[i, j], choice[i, j] = total[best], middle[best]
    triangles = []
    todo = [(0, count - 1)]
    while todo:
        i, j = todo.pop()
        if j - i < 2:
            continue
        k = int(choice[i, j])
        triangles.append((i, k, j))
        todo += [(i, k), (k, j)]
    return np.array(triangles, dtype=np.int64)


def _in_mean_plane(points: Floats) -> Ints:
    """Triangulate a polygon by its projection along its mean normal."""
    import manifold3d

    centred = points - points.mean(0)
    normal = np.cross(centred, np.roll(centred, -1, axis=0)).sum(0)
    normal = normal / max(float(np.linalg.norm(normal)), 1e-300)
    across = np.eye(3)[int(np.argmin(np.abs(normal)))]
    u = np.cross(normal, across)
    u = u / max(float(np.linalg.norm(u)), 1e-300)
    flat = np.stack([centred @ u, centred @ np.cross(normal, u)], axis=1)
    return np.array(manifold3d.triangulate([np.ascontiguousarray(flat)], 0.0)).astype(np.int64)
