# SPDX-License-Identifier: Apache-2.0
"""Skirts: what lies above and outside of a sheet's rim."""

from __future__ import annotations

from typing import Any

import numpy as np

from vega_planner.datatypes import Floats, Ints

#: How far the rim's vertices may lie off the line that takes their place [mm]: much less
#: than a substrate's clearance.
STRAIGHT_MM = 0.02

#: Vertices one line takes the place of, at most.
MOST_PASSED = 64


def rim_edges(faces: Ints) -> Ints:
    """Directed edges that have a face on one side only, shape (k, 2)."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    count = int(faces.max()) + 1
    key = edges[:, 0] * count + edges[:, 1]
    back = edges[:, 1] * count + edges[:, 0]
    return edges[~np.isin(key, back)]


def skirts(vertices: Floats, faces: Ints, width_mm: float, top_mm: float) -> Any:
    """Make the solid above and outside of a sheet's rim: a wall must not rise over it.

    Args:
        vertices: Points [mm], shape (n, 3).
        faces: The sheet's faces, which face down, shape (m, 3).
        width_mm: How far it reaches outwards.
        top_mm: Height up to which it reaches.

    Returns:
        A `manifold3d.Manifold`.
    """
    import manifold3d

    rim = _straightened(vertices, rim_edges(faces))
    along = vertices[rim[:, 1], :2] - vertices[rim[:, 0], :2]
    # the sheet faces down: seen from above it runs clockwise, and outside is to the left
    out = np.column_stack([-along[:, 1], along[:, 0]])
    normal = np.zeros((len(vertices), 2))
    for end in (0, 1):
        np.add.at(normal, rim[:, end], out)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.divide(normal, length, out=np.zeros_like(normal), where=length > 1e-12)
    pieces = []
    for a, b in rim:
        corners = []
        for v in (a, b):
            x, y, z = vertices[v]
            for far in (0.0, width_mm):
                corners.append((x + far * normal[v, 0], y + far * normal[v, 1], z))
                corners.append((x + far * normal[v, 0], y + far * normal[v, 1], top_mm))
        piece = manifold3d.Manifold.hull_points(np.array(corners))
        if not piece.is_empty():
            pieces.append(piece)
    # neighbours first: what they share is gone before the whole gets large
    while len(pieces) > 1:
        pairs = [pieces[k : k + 2] for k in range(0, len(pieces), 2)]
        pieces = [manifold3d.Manifold.batch_boolean(pair, manifold3d.OpType.Add) for pair in pairs]
        for piece in pieces:
            piece.num_tri()  # work it out now
    return pieces[0] if pieces else manifold3d.Manifold()


def _straightened(vertices: Floats, rim: Ints) -> Ints:
    """Chain directed edges, and take one for those that lie nearly on a line, in order."""
    after: dict[int, list[int]] = {}
    for a, b in rim[::-1]:
        after.setdefault(int(a), []).append(int(b))
    edges = []
    for start in rim[:, 0]:
        chain = [int(start)]
        while after.get(chain[-1]):
            chain.append(after[chain[-1]].pop())
        at = 0
        while at < len(chain) - 1:
            to = at + 1
            while to + 1 < len(chain) and to - at < MOST_PASSED and chain[to + 1] != chain[at]:
                if not _near_line(vertices[chain[at : to + 2]]):
                    break
                to += 1
            edges.append((chain[at], chain[to]))
            at = to
    return np.array(edges, np.int64).reshape(-1, 2)


def _near_line(points: Floats) -> bool:
    """Tell whether points lie near the segment from the first to the last of them."""
    along = points[-1] - points[0]
    t = np.clip((points - points[0]) @ along / max(float(along @ along), 1e-300), 0.0, 1.0)
    off = points - points[0] - t[:, None] * along
    return bool((off * off).sum(1).max() <= STRAIGHT_MM**2)
