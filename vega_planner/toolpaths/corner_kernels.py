# SPDX-License-Identifier: Apache-2.0
"""Kernel that gives loops the corners that the mesh they were drawn on has blunted."""

from __future__ import annotations

import math

import numpy as np

from vega_planner.compiled import kernel


@kernel
def _gap(a, b):
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@kernel
def _straight_before(rows, sums, at, back, reach, slack, out):
    """Direction of a loop on its way to a row, or away from it where `back` is -1.

    Returns:
        Whether all rows within `reach` lie within `slack` of a straight line.
    """
    n = rows.shape[0]
    total = sums[n]
    far = at
    run = 0.0
    while run < reach:
        after = (far - back + n) % n
        step = sums[far] - sums[after] if back > 0 else sums[after] - sums[far]
        if step < 0.0:
            step += total
        run += step
        far = after
        if run >= 0.4 * total:
            return False
    size = _gap(rows[far], rows[at])
    if size < 0.5 * reach:
        return False
    for c in range(3):
        out[c] = back * (rows[at, c] - rows[far, c]) / size
    k = far
    while k != at:
        along = 0.0
        square = 0.0
        for c in range(3):
            d = rows[k, c] - rows[at, c]
            along += d * out[c]
            square += d * d
        if square - along * along > slack * slack:
            return False
        k = (k + back + n) % n
    return True


@kernel
def with_corners(rows, normal, spacing, widest, sharp):
    """Give a loop the corners that the mesh it was drawn on has blunted.

    Where two straight runs meet within a short way, they are drawn out to where they
    cross; a sharp corner a little farther, so that the place between it and the corner of
    the next loop outside is no farther from both than `widest`. With a the half angle
    inside the corner, loops s apart leave a place (s - e sin a) / (1 + sin a) away from
    corners that stand out by e.

    Args:
        rows: The loop, inside to its left, first row not repeated, shape (n, c).
        normal: First of the three columns that hold the surface's normal.
        spacing: Distance s between loops [mm].
        widest: Largest distance wanted [mm].
        sharp: Smallest turn that makes a corner [rad].

    Returns:
        Rows, shape (k, c).
    """
    n, width = rows.shape
    reach, within, slack = 0.6, 0.75, 0.03
    sums = np.zeros(n + 1)
    for q in range(n):
        sums[q + 1] = sums[q] + _gap(rows[q], rows[(q + 1) % n])
    total = sums[n]
    if n < 8 or total < 6.0:
        return rows.copy()
    into = np.empty((n, 3))
    away = np.empty((n, 3))
    calm_in = np.zeros(n, np.bool_)
    calm_out = np.zeros(n, np.bool_)
    for q in range(n):
        calm_in[q] = _straight_before(rows, sums, q, 1, reach, slack, into[q])
        calm_out[q] = _straight_before(rows, sums, q, -1, reach, slack, away[q])
    kind = np.zeros(n, np.int64)  # 1: dropped, 2: a corner takes its place
    tips = np.zeros((n, 3, width))
    for i in range(n):
        if not calm_in[i] or kind[i] > 0:
            continue
        j = i
        run = 0.0
        for _ in range(n):
            if run > within:
                break
            turn = 0.0
            if calm_out[j]:
                for c in range(3):
                    turn += into[i, c] * away[j, c]
                turn = math.acos(min(max(turn, -1.0), 1.0))
            if turn >= sharp:
                break
            run += _gap(rows[j], rows[(j + 1) % n])
            j = (j + 1) % n
        if run > within or turn < sharp or turn > 2.8:
            continue
        # a turn to the left, over a surface that hardly bends
        x = into[i, 1] * away[j, 2] - into[i, 2] * away[j, 1]
        y = into[i, 2] * away[j, 0] - into[i, 0] * away[j, 2]
        z = into[i, 0] * away[j, 1] - into[i, 1] * away[j, 0]
        side = x * rows[i, normal] + y * rows[i, normal + 1] + z * rows[i, normal + 2]
        bend = 0.0
        for c in range(3):
            bend += rows[i, normal + c] * rows[j, normal + c]
        size = 0.0
        for c in range(3):
            size += rows[i, normal + c] ** 2
        if side <= 0.0 or bend < 0.97 * size:
            continue
        # where the two straight lines come nearest to each other
        du = dv = 0.0
        cosine = math.cos(turn)
        for c in range(3):
            d = rows[j, c] - rows[i, c]
            du += d * into[i, c]
            dv += d * away[j, c]
        u = (du - cosine * dv) / (1.0 - cosine * cosine)
        v = (dv - cosine * du) / (1.0 - cosine * cosine)
        if u < -1e-9 or v < -1e-9 or u > 1.0 or v > 1.0:
            continue
        miss = 0.0
        for c in range(3):
            a = rows[i, c] + u * into[i, c]
            b = rows[j, c] - v * away[j, c]
            miss += (a - b) ** 2
        if miss > 0.05**2:
            continue
        half = math.sin(0.5 * (math.pi - turn))
        stand = min(max((spacing - widest * (1.0 + half)) / half, 0.0), 0.35 * spacing)
        base = min(2.0 * stand, 0.35 * spacing)
        outward = 0.0
        for c in range(3):
            outward += (into[i, c] - away[j, c]) ** 2
        outward = math.sqrt(outward)
        for c in range(width):
            tips[i, 0, c] = rows[i, c]
            tips[i, 1, c] = 0.5 * (rows[i, c] + rows[j, c])
            tips[i, 2, c] = rows[j, c]
        for c in range(3):
            corner = 0.5 * (rows[i, c] + u * into[i, c] + rows[j, c] - v * away[j, c])
            tips[i, 0, c] = corner - base * into[i, c]
            tips[i, 1, c] = corner + stand * (into[i, c] - away[j, c]) / outward
            tips[i, 2, c] = corner + base * away[j, c]
        k = i
        while True:
            kind[k] = 1
            if k == j:
                break
            k = (k + 1) % n
        for way in range(2):  # what lies between the base of the corner and its tip
            k = (i - 1 + n) % n if way == 0 else (j + 1) % n
            for _ in range(n):
                d = 0.0
                for c in range(3):
                    if way == 0:
                        d += (rows[k, c] - tips[i, 0, c]) * into[i, c]
                    else:
                        d -= (rows[k, c] - tips[i, 2, c]) * away[j, c]
                if d < 0.0:
                    break
                kind[k] = max(kind[k], 1)
                k = (k - 1 + n) % n if way == 0 else (k + 1) % n
        kind[i] = 2 if base < 1e-3 else 3
    count = 0
    for q in range(n):
        if kind[q] != 1:
            count += 3 if kind[q] == 3 else 1
    out = np.empty((count, width))
    k = 0
    for q in range(n):
        if kind[q] == 0:
            out[k] = rows[q]
            k += 1
        elif kind[q] == 2:
            out[k] = tips[q, 1]
            k += 1
        elif kind[q] == 3:
            out[k : k + 3] = tips[q]
            k += 3
    return out
