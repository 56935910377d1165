# SPDX-License-Identifier: Apache-2.0
"""Kernels that calm the nozzle's direction along a pass.

Axes come from mesh vertices, whose noise would shake the rotary joints: at 5 mm/s a
change of a few degrees within a tenth of a millimetre already asks for more
acceleration than a small motor has. The axis is free to be smooth where the tip is not.
"""

from __future__ import annotations

import math

import numpy as np

from vega_planner.compiled import kernel


@kernel
def without_crowding(rows, least):
    """Drop rows that lie nearer than `least` to the one kept before; keep both ends.

    Args:
        rows: Polyline, position in columns 0..2, shape (n, c), n >= 2.
        least: Smallest distance between rows [mm].

    Returns:
        Rows, shape (k, c), 2 <= k <= n.
    """
    n = rows.shape[0]
    keep = np.empty(n, np.int64)
    keep[0] = 0
    k = 1
    for i in range(1, n):
        gap = 0.0
        for c in range(3):
            gap += (rows[i, c] - rows[keep[k - 1], c]) ** 2
        if gap >= least * least:
            keep[k] = i
            k += 1
        elif i == n - 1:
            if k > 1:
                keep[k - 1] = i
            else:
                keep[k] = i
                k += 1
    return rows[keep[:k]]


@kernel
def smooth_axes(rows, first, sigma, closed):
    """Average unit vectors along a polyline with a Gaussian of the length along it.

    Args:
        rows: Polyline, position in columns 0..2, shape (n, c).
        first: First of the three columns that hold the unit vector.
        sigma: Standard deviation of the weight [mm].
        closed: Whether the last row repeats the first; the average then runs round.

    Returns:
        A copy of the rows with the averaged unit vectors.
    """
    n = rows.shape[0]
    sums = np.zeros(n)
    for i in range(1, n):
        gap = 0.0
        for c in range(3):
            gap += (rows[i, c] - rows[i - 1, c]) ** 2
        sums[i] = sums[i - 1] + math.sqrt(gap)
    share = np.zeros(n)  # length that each row stands for
    for i in range(n - 1):
        half = 0.5 * (sums[i + 1] - sums[i])
        share[i] += half
        share[i + 1] += half
    if closed:  # both copies of the seam stand for the length on both its sides
        share[0] += share[n - 1]
        share[n - 1] = share[0]
    total = sums[n - 1]
    out = rows.copy()
    if total < 1e-6:  # all in one place: there is no way to go round
        return out
    for i in range(n):
        x = y = z = 0.0
        for way in range(2):
            j = i if way == 0 else i - 1
            lap = 0.0
            while True:
                if j >= n:
                    if not closed:
                        break
                    j, lap = 1, lap + total
                elif j < 0:
                    if not closed:
                        break
                    j, lap = n - 2, lap - total
                away = sums[j] + lap - sums[i]
                if abs(away) > 3.0 * sigma or abs(lap) > total:
                    break
                w = share[j] * math.exp(-0.5 * (away / sigma) ** 2)
                x += w * rows[j, first]
                y += w * rows[j, first + 1]
                z += w * rows[j, first + 2]
                j += 1 if way == 0 else -1
        size = math.sqrt(x * x + y * y + z * z)
        if size > 1e-6:
            out[i, first], out[i, first + 1], out[i, first + 2] = x / size, y / size, z / size
    return out
