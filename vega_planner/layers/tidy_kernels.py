# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Compiled merging and flipping of the edges of slivers."""

from __future__ import annotations

import numpy as np

from vega_planner.compiled import inner_kernel, kernel
from vega_planner.layers.triangle_kernels import walk_from
from vega_planner.part.surface_kernels import cross_of

#: Longest edge whose ends are merged, and longest of the rim [mm].
SHORT_MM, SHORT_RIM_MM = 0.1, 0.02

#: Height below which a face has no area to speak of [mm].
FLAT_MM = 1e-4

#: Distance from the level set that the centre of a new face may have [mm].
CENTRE_MM = 0.015

#: Least cosine between the normals of a face before and after a change.
ALIKE = 0.95

#: Most faces about a vertex that is changed.
MOST_AROUND = 32


@inner_kernel
def squared(vertices, a, b):
    """Return the squared length of an edge."""
    total = 0.0
    for k in range(3):
        total += (vertices[a, k] - vertices[b, k]) ** 2
    return total


@inner_kernel
def shape_of(vertices, a, b, c, normal):
    """Measure a triangle.

    Args:
        normal: Result: its unit normal, zero where it has no area.

    Returns:
        Its height over the longest side [mm].
    """
    area = cross_of(vertices, a, b, c, normal)
    longest = np.sqrt(
        max(squared(vertices, a, b), squared(vertices, a, c), squared(vertices, b, c))
    )
    for k in range(3):
        normal[k] = normal[k] / area if area > 1e-12 else 0.0
    return area / max(longest, 1e-12)


@inner_kernel
def centre_error(tri, corner, ring_start, ring, vertices, slots, a, b, c, r):
    """Measure how far the centre of a face is from the level set."""
    x = (vertices[a, 0] + vertices[b, 0] + vertices[c, 0]) / 3.0
    y = (vertices[a, 1] + vertices[b, 1] + vertices[c, 1]) / 3.0
    z = (vertices[a, 2] + vertices[b, 2] + vertices[c, 2]) / 3.0
    _, least = walk_from(tri, corner, ring_start, ring, slots[a], slots[b], slots[c], x, y, z)
    return abs(np.sqrt(least) - r)


@inner_kernel
def neighbours(faces, start, around, v, out):
    """List the vertices that share an edge with v; a rim vertex has one more than faces."""
    count = 0
    for i in range(start[v], start[v + 1]):
        for c in range(3):
            w = faces[around[i], c]
            if w == v:
                continue
            known = False
            for q in range(count):
                if out[q] == w:
                    known = True
                    break
            if not known:
                out[count] = w
                count += 1
    return count


@inner_kernel
def has(faces, f, v):
    """Tell whether a face has a corner."""
    return faces[f, 0] == v or faces[f, 1] == v or faces[f, 2] == v


@inner_kernel
def fits(
    tri, corner, ring_start, ring, vertices, slots, a, b, c, r, height, allowed, old, ox, oy, oz,
    normal,
):  # fmt: skip
    """Tell whether a new face may take the place of one with normal o and height old."""
    tall = shape_of(vertices, a, b, c, normal)
    if (tall < height and tall < 0.999 * old) or tall < 1e-6:
        return False
    if old >= height and normal[0] * ox + normal[1] * oy + normal[2] * oz < ALIKE:
        return False
    return centre_error(tri, corner, ring_start, ring, vertices, slots, a, b, c, r) <= allowed


@inner_kernel
def can_merge(
    tri, corner, ring_start, ring, vertices, slots, faces, start, around, r, height, gone, stays,
    mine, others, new, normal, other,
):  # fmt: skip
    """Tell whether vertex `gone` may become `stays`."""
    first, last = start[gone], start[gone + 1]
    if last - first > MOST_AROUND or start[stays + 1] - start[stays] > MOST_AROUND:
        return False
    count = neighbours(faces, start, around, gone, mine)
    other_count = neighbours(faces, start, around, stays, others)
    shared = 0
    for i in range(first, last):
        if has(faces, around[i], stays):
            shared += 1
    common = 0
    for p in range(count):
        for q in range(other_count):
            if mine[p] == others[q]:
                common += 1
    if common != shared or shared < 1 or shared > 2 or last - first < 3 + (shared < 2):
        return False
    if count != last - first:
        # A rim vertex may go along the rim only.
        if shared != 1 or squared(vertices, gone, stays) > SHORT_RIM_MM**2:
            return False
    elif shared != 2:
        return False
    for i in range(first, last):
        f = around[i]
        if has(faces, f, stays):
            continue
        old = shape_of(vertices, faces[f, 0], faces[f, 1], faces[f, 2], normal)
        for c in range(3):
            new[c] = stays if faces[f, c] == gone else faces[f, c]
        allowed = max(
            CENTRE_MM,
            centre_error(
                tri, corner, ring_start, ring, vertices, slots,
                faces[f, 0], faces[f, 1], faces[f, 2], r,
            ),
        )  # fmt: skip
        if not fits(
            tri, corner, ring_start, ring, vertices, slots, new[0], new[1], new[2], r, height,
            allowed, old, normal[0], normal[1], normal[2], other,
        ):  # fmt: skip
            return False
        if old < height and not keeps_side(vertices, slots, tri, new, normal):
            return False
    return True


@inner_kernel
def keeps_side(vertices, slots, tri, new, normal):
    """Tell whether a face looks towards S, as the outward side of a sheet does."""
    shape_of(vertices, new[0], new[1], new[2], normal)
    for c in range(3):
        s = slots[new[c]]
        if normal[0] * tri[s, 9] + normal[1] * tri[s, 10] + normal[2] * tri[s, 11] > 0.3:
            return True
    return False


@inner_kernel
def flip(
    tri, corner, ring_start, ring, vertices, slots, faces, start, around, r, height, f, side, flat,
    mine, normal, other,
):  # fmt: skip
    """Flip the edge of face f that begins at corner `side`, if that may be.

    Two faces on one line, which both are flat, are turned so that their edge gets shorter:
    then each has its long edge in common with another face.

    Returns:
        The other face of the edge, -1 where it stays.
    """
    p, q, c = faces[f, side], faces[f, (side + 1) % 3], faces[f, (side + 2) % 3]
    g, shared = -1, 0
    for i in range(start[p], start[p + 1]):
        if has(faces, around[i], q):
            shared += 1
            if around[i] != f:
                g = around[i]
    if shared != 2 or g < 0 or start[c + 1] - start[c] > MOST_AROUND:
        return -1
    d = faces[g, 0] + faces[g, 1] + faces[g, 2] - p - q
    for i in range(neighbours(faces, start, around, c, mine)):
        if mine[i] == d:
            return -1
    old = shape_of(vertices, faces[g, 0], faces[g, 1], faces[g, 2], normal)
    if old < FLAT_MM and flat:
        if squared(vertices, c, d) >= 0.9 * squared(vertices, p, q):
            return -1
        faces[f, 0], faces[f, 1], faces[f, 2] = p, d, c
        faces[g, 0], faces[g, 1], faces[g, 2] = d, q, c
        return g
    if old < height and not flat:
        return -1
    least = 5.0 * FLAT_MM if flat else height
    allowed = max(
        CENTRE_MM,
        centre_error(
            tri, corner, ring_start, ring, vertices, slots,
            faces[g, 0], faces[g, 1], faces[g, 2], r,
        ),
    )  # fmt: skip
    for x, y, z in ((p, d, c), (d, q, c)):
        # Both new faces must be better than a sliver, or at least not flat again.
        if not fits(
            tri, corner, ring_start, ring, vertices, slots, x, y, z, r, least, allowed,
            1e30, normal[0], normal[1], normal[2], other,
        ):  # fmt: skip
            return -1
    faces[f, 0], faces[f, 1], faces[f, 2] = p, d, c
    faces[g, 0], faces[g, 1], faces[g, 2] = d, q, c
    return g


@kernel
def tidy_faces(
    tri, corner, ring_start, ring, vertices, slots, faces, tall, start, around, r, height
):
    """Go through the slivers of a sheet once; faces that vanish are left out.

    Around a change nothing else is changed, since the lists of faces no longer hold.

    Args:
        tri: Triangle rows of S, with `corner`, `ring_start` and `ring`.
        vertices: Points [mm], (n, 3).
        slots: A triangle of S next to each vertex, (n,).
        faces: Vertex indices, changed in place, (m, 3).
        tall: 1 for faces that are known to be no slivers, changed in place, (m,).
        start: Where the faces about each vertex begin in `around`, (n + 1,).
        around: Those faces.
        r: Depth of the sheet [mm].
        height: Height below which a face is a sliver [mm].

    Returns:
        Number of changes, of slivers that were not looked at for others about them, of those
        that are or were flat among both, and of the faces that are left, which come first.
    """
    locked = np.zeros(len(vertices), np.uint8)
    mine, others = np.zeros(2 * MOST_AROUND + 2, np.int64), np.zeros(2 * MOST_AROUND + 2, np.int64)
    normal, other = np.zeros(3), np.zeros(3)
    side, new = np.zeros(3), np.zeros(3, np.int64)
    changed, skipped, flats = 0, 0, 0
    for f in range(len(faces)):
        if faces[f, 0] < 0 or tall[f]:
            continue
        mine_height = shape_of(vertices, faces[f, 0], faces[f, 1], faces[f, 2], normal)
        if mine_height >= height:
            tall[f] = 1
            continue
        flat = mine_height < FLAT_MM
        if locked[faces[f, 0]] or locked[faces[f, 1]] or locked[faces[f, 2]]:
            skipped += 1
            flats += flat
            continue
        for c in range(3):
            side[c] = squared(vertices, faces[f, c], faces[f, (c + 1) % 3])
        short, long = np.argmin(side), np.argmax(side)
        done = False
        if side[short] < SHORT_MM * SHORT_MM:
            for turn in range(2):
                gone = faces[f, (short + turn) % 3]
                stays = faces[f, (short + 1 - turn) % 3]
                if not can_merge(
                    tri, corner, ring_start, ring, vertices, slots, faces, start, around, r,
                    height, gone, stays, mine, others, new, normal, other,
                ):  # fmt: skip
                    continue
                for i in range(start[gone], start[gone + 1]):
                    g = around[i]
                    for c in range(3):
                        locked[faces[g, c]] = 1
                    if has(faces, g, stays):
                        faces[g, 0] = -1
                        continue
                    tall[g] = 0
                    for c in range(3):
                        if faces[g, c] == gone:
                            faces[g, c] = stays
                for i in range(start[stays], start[stays + 1]):
                    if faces[around[i], 0] >= 0:
                        for c in range(3):
                            locked[faces[around[i], c]] = 1
                changed += 1
                flats += flat
                done = True
                break
        if done:
            continue
        g = flip(
            tri, corner, ring_start, ring, vertices, slots, faces, start, around, r, height, f,
            long, flat, mine, normal, other,
        )  # fmt: skip
        if g >= 0:
            flats += flat
            tall[f] = tall[g] = 0
            for c in range(3):
                locked[faces[f, c]] = 1
                locked[faces[g, c]] = 1
            changed += 1
    left = 0
    for f in range(len(faces)):
        if faces[f, 0] >= 0:
            for c in range(3):
                faces[left, c] = faces[f, c]
            tall[left] = tall[f]
            left += 1
    return changed, skipped, flats, left


@kernel
def drop_flat(vertices, faces):
    """Put -1 as the first corner of faces with two corners at one place.

    Returns:
        Number of such faces.
    """
    count = 0
    for f in range(len(faces)):
        for c in range(3):
            if squared(vertices, faces[f, c], faces[f, (c + 1) % 3]) == 0.0:
                faces[f, 0] = -1
                count += 1
                break
    return count


@kernel
def mark_ears(vertices, faces, start, around, ears):
    """Mark the faces with two open edges that are folded onto a larger only neighbour."""
    mine, other = np.zeros(3), np.zeros(3)
    for f in range(len(faces)):
        count, g, uses = 0, -1, 0
        for c in range(3):
            p, q = faces[f, c], faces[f, (c + 1) % 3]
            shared, last = 0, -1
            for i in range(start[p], start[p + 1]):
                if around[i] != f and has(faces, around[i], q):
                    shared += 1
                    last = around[i]
            if shared:
                count += 1
                g, uses = last, shared
            if count > 1:
                break
        if count != 1 or uses != 1:
            continue
        size = cross_of(vertices, faces[f, 0], faces[f, 1], faces[f, 2], mine)
        if size > cross_of(vertices, faces[g, 0], faces[g, 1], faces[g, 2], other):
            continue
        ears[f] = mine[0] * other[0] + mine[1] * other[1] + mine[2] * other[2] < 0.0
