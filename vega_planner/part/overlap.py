# SPDX-License-Identifier: Apache-2.0
"""A quick look through the part for places that its surface winds round twice.

Rays on a coarse grid cross the surface; the winding number along each ray must step
between 0 and 1. Self-intersections of less than the grid are too small to matter.
"""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Floats, Ints

#: Rays along the longer side of the part.
RAYS = 96


def overlap_depth(vertices: Floats, faces: Ints, axis: int = 2) -> tuple[float, float]:
    """Measure where a closed surface overlaps itself or runs inside out.

    Args:
        vertices: Points [mm], shape (n, 3).
        faces: Vertex indices of a closed, oriented surface, shape (m, 3).
        axis: Direction of the rays, 0 to 2.

    Returns:
        The longest stretch of a ray on which the winding number is neither 0 nor 1 [mm],
        and the share of such stretches in all that is inside.
    """
    u, v = (axis + 1) % 3, (axis + 2) % 3
    flat = vertices[:, (u, v)]
    low = flat.min(0)
    step = float((flat.max(0) - low).max()) / RAYS
    # Offsets of unrelated roots keep rays off the vertices and edges of regular meshes.
    origin = low - step * np.array([0.38196601125, 0.29289321881])
    a, b, c = (flat[faces[:, k]] for k in range(3))
    lowest, highest = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    first = np.ceil((lowest - origin) / step).astype(np.int64)
    last = np.floor((highest - origin) / step).astype(np.int64)
    spans = np.maximum(last - first + 1, 0)
    many = spans[:, 0] * spans[:, 1]
    face = np.repeat(np.arange(len(faces)), many)
    rank = np.arange(len(face)) - np.repeat(np.cumsum(many) - many, many)
    i = first[face, 0] + rank // spans[face, 1]
    j = first[face, 1] + rank % spans[face, 1]
    x, y = origin[0] + i * step, origin[1] + j * step
    a, b, c = a[face], b[face], c[face]
    wa = (b[:, 0] - x) * (c[:, 1] - y) - (b[:, 1] - y) * (c[:, 0] - x)
    wb = (c[:, 0] - x) * (a[:, 1] - y) - (c[:, 1] - y) * (a[:, 0] - x)
    wc = (a[:, 0] - x) * (b[:, 1] - y) - (a[:, 1] - y) * (b[:, 0] - x)
    up = (wa > 0) & (wb > 0) & (wc > 0)
    hit = up | ((wa < 0) & (wb < 0) & (wc < 0))
    face, wa, wb, wc, up = face[hit], wa[hit], wb[hit], wc[hit], up[hit]
    ray = (i * (2 * RAYS + 8) + j)[hit]
    depth = vertices[faces[face], axis]
    height = (wa * depth[:, 0] + wb * depth[:, 1] + wc * depth[:, 2]) / (wa + wb + wc)
    order = np.lexsort((height, ray))
    ray, height = ray[order], height[order]
    sign = np.where(up[order], -1, 1)  # entering through a face that looks down
    starts = np.flatnonzero(np.diff(ray, prepend=-1))
    # A ray that met an edge after all misses a crossing; it is left out.
    sound = np.add.reduceat(sign, starts) == 0 if len(starts) else starts == 0
    kept = np.repeat(sound, np.diff(starts, append=len(ray)))
    ray, height, turns = ray[kept], height[kept], np.cumsum(sign[kept])
    length = np.where(np.diff(ray) == 0, np.diff(height), 0.0)
    wrong = (turns[:-1] < 0) | (turns[:-1] > 1)
    inside = float(length[turns[:-1] != 0].sum())
    if not wrong.any() or inside <= 0:
        return 0.0, 0.0
    return float(length[wrong].max()), float(length[wrong].sum()) / inside
