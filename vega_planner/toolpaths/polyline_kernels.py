# SPDX-License-Identifier: Apache-2.0
"""Kernels on polylines whose rows start with a position.

Rows have shape (n, c): position in columns 0..2, anything to be interpolated after it.
"""

from __future__ import annotations

import math

import numpy as np

from vega_planner.compiled import kernel


@kernel
def _gap(a, b):
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@kernel
def line_length(rows, closed):
    """Length of a polyline; a closed one does not repeat its first row."""
    total = 0.0
    for q in range(rows.shape[0] - 1):
        total += _gap(rows[q], rows[q + 1])
    if closed:
        total += _gap(rows[-1], rows[0])
    return total


@kernel
def nearest_on(rows, closed, p):
    """Find the nearest point of a polyline.

    Returns:
        Distance, segment it lies on and the place on that segment in 0..1.
    """
    n = rows.shape[0]
    best = 1e300
    segment = 0
    place = 0.0
    for q in range(n if closed else n - 1):
        a = rows[q]
        b = rows[(q + 1) % n]
        dx = b[0] - a[0]
        dy = b[1] - a[1]
        dz = b[2] - a[2]
        ll = dx * dx + dy * dy + dz * dz
        w = 0.0
        if ll > 0.0:
            w = ((p[0] - a[0]) * dx + (p[1] - a[1]) * dy + (p[2] - a[2]) * dz) / ll
            w = min(max(w, 0.0), 1.0)
        x = (p[0] - a[0] - w * dx) ** 2 + (p[1] - a[1] - w * dy) ** 2 + (p[2] - a[2] - w * dz) ** 2
        if x < best:
            best = x
            segment = q
            place = w
    return math.sqrt(best), segment, place


@kernel
def unroll(rows, segment, place, forward, gap):
    """Open a loop at a point and walk it once, stopping before the start.

    Args:
        rows: The loop, first row not repeated, shape (n, c).
        segment: Segment of the start.
        place: Place of the start on its segment, 0..1.
        forward: Walk in the order of the rows, or against it.
        gap: Length left out at the end; 0 closes the loop.

    Returns:
        Rows from the start to the end, shape (k, c), k >= 2.
    """
    n, width = rows.shape
    ring = np.empty((n + 2, width))
    after = (segment + 1) % n
    for c in range(width):
        ring[0, c] = (1.0 - place) * rows[segment, c] + place * rows[after, c]
        ring[n + 1, c] = ring[0, c]
    for q in range(n):
        ring[q + 1] = rows[(after + q) % n] if forward else rows[(segment - q + n) % n]
    total = 0.0
    for q in range(n + 1):
        total += _gap(ring[q], ring[q + 1])
    wanted = total - min(gap, 0.5 * total)
    out = np.empty((n + 2, width))
    out[0] = ring[0]
    k = 1
    walked = 0.0
    for q in range(n + 1):
        step = _gap(ring[q], ring[q + 1])
        if step < 1e-6:
            continue
        if walked + step >= wanted - 1e-9:
            w = min(max((wanted - walked) / step, 0.0), 1.0)
            if w * step > 1e-6 or k < 2:
                for c in range(width):
                    out[k, c] = (1.0 - w) * ring[q, c] + w * ring[q + 1, c]
                k += 1
            break
        out[k] = ring[q + 1]
        k += 1
        walked += step
    return out[:k].copy()


@kernel
def _at_length(rows, sums, s, out):
    """Interpolate a closed polyline at a length along it."""
    n = rows.shape[0]
    total = sums[n]
    s = s % total
    q = np.searchsorted(sums, s, side="right") - 1
    q = min(max(q, 0), n - 1)
    step = sums[q + 1] - sums[q]
    w = (s - sums[q]) / step if step > 0.0 else 0.0
    for c in range(rows.shape[1]):
        out[c] = (1.0 - w) * rows[q, c] + w * rows[(q + 1) % n, c]


@kernel
def middle_line(rows):
    """Draw the line halfway between the two sides of a thin loop.

    Args:
        rows: The loop, first row not repeated, shape (n, c).

    Returns:
        Rows from one end to the other, shape (k, c).
    """
    n, width = rows.shape
    sums = np.zeros(n + 1)
    for q in range(n):
        sums[q + 1] = sums[q] + _gap(rows[q], rows[(q + 1) % n])
    total = sums[n]
    half = max(2, n // 2)
    a = np.empty(width)
    b = np.empty(width)
    best = -1.0
    start = 0.0
    for q in range(2 * half):
        s = total * q / (2 * half)
        _at_length(rows, sums, s, a)
        _at_length(rows, sums, s + 0.5 * total, b)
        x = _gap(a, b)
        if x > best:
            best = x
            start = s
    out = np.empty((half + 1, width))
    for q in range(half + 1):
        s = 0.5 * total * q / half
        _at_length(rows, sums, start + s, a)
        _at_length(rows, sums, start - s + total, b)
        for c in range(width):
            out[q, c] = 0.5 * (a[c] + b[c])
    return out


@kernel
def keep_inside(rows, closed, column, spacing, least, most):
    """Cut a line where it comes too near the rim.

    A line that runs at the rim is cut `most` away from it, one that runs along it
    `least`: the end of a bead asks for more room than its side, since every second end
    carries a link.

    Args:
        rows: The line, shape (n, c).
        closed: Whether the last row joins the first.
        column: Column that holds the distance from the rim [mm].
        spacing: Unit of `least` and `most` [mm].
        least: Distance kept by a line along the rim, in spacings.
        most: Distance kept by a line straight at the rim, in spacings.

    Returns:
        The pieces as (start, end, place before the start, place after the end), one row
        each of shape (4,): rows start..end lie inside, and the piece begins that part
        of a segment before row `start` and ends that part of one after row `end`.
    """
    n = rows.shape[0]
    room = np.empty(n)
    for q in range(n):
        a = q - 1 if q > 0 else (n - 1 if closed else 0)
        b = q + 1 if q + 1 < n else (0 if closed else n - 1)
        run = _gap(rows[a], rows[b])
        slope = abs(rows[b, column] - rows[a, column]) / run if run > 1e-9 else 0.0
        slope = min(slope, 1.0)
        room[q] = rows[q, column] - spacing * (least + (most - least) * slope)
    pieces = np.empty((n, 4))
    k = 0
    q = 0
    while q < n:
        if room[q] < 0.0:
            q += 1
            continue
        first = q
        while q + 1 < n and room[q + 1] >= 0.0:
            q += 1
        pieces[k, 0] = first
        pieces[k, 1] = q
        pieces[k, 2] = 0.0
        pieces[k, 3] = 0.0
        if first > 0:
            pieces[k, 2] = room[first] / (room[first] - room[first - 1])
        if q + 1 < n:
            pieces[k, 3] = room[q] / (room[q] - room[q + 1])
        k += 1
        q += 1
    return pieces[:k].copy()


@kernel
def resample(rows, chord, step, cosine):
    """Thin a polyline out, and put points where it has too few.

    Args:
        rows: The line, position in columns 0..2 and tool axis in 3..5, shape (n, c).
        chord: Largest distance of a left-out row from its segment [mm].
        step: Longest segment [mm].
        cosine: Cosine of the largest angle between neighbouring axes.

    Returns:
        Rows, shape (k, c); the first and the last are kept.
    """
    n, width = rows.shape
    picked = np.empty(n, np.int64)
    picked[0] = 0
    k = 1
    i = 0
    while i < n - 1:
        best = i + 1
        j = i + 2
        while j < n:
            if _gap(rows[i], rows[j]) > step:
                break
            if (
                rows[i, 3] * rows[j, 3] + rows[i, 4] * rows[j, 4] + rows[i, 5] * rows[j, 5]
                < cosine
            ):
                break
            good = True
            ll = _gap(rows[i], rows[j]) ** 2
            for m in range(i + 1, j):
                w = 0.0
                if ll > 0.0:
                    for c in range(3):
                        w += (rows[m, c] - rows[i, c]) * (rows[j, c] - rows[i, c])
                    w = min(max(w / ll, 0.0), 1.0)
                x = 0.0
                for c in range(3):
                    x += (rows[m, c] - rows[i, c] - w * (rows[j, c] - rows[i, c])) ** 2
                if x > chord * chord:
                    good = False
                    break
            if not good:
                break
            best = j
            j += 1
        picked[k] = best
        k += 1
        i = best
    total = 1
    parts = np.empty(k, np.int64)
    for q in range(k - 1):
        x = _gap(rows[picked[q]], rows[picked[q + 1]])
        a = rows[picked[q]]
        b = rows[picked[q + 1]]
        turn = math.acos(min(max(a[3] * b[3] + a[4] * b[4] + a[5] * b[5], -1.0), 1.0))
        parts[q] = max(
            1,
            math.ceil(x / step - 1e-9),
            math.ceil(turn / math.acos(cosine) - 1e-9),
        )
        total += parts[q]
    out = np.empty((total, width))
    out[0] = rows[0]
    m = 1
    for q in range(k - 1):
        for p in range(1, parts[q] + 1):
            w = p / parts[q]
            for c in range(width):
                out[m, c] = (1.0 - w) * rows[picked[q], c] + w * rows[picked[q + 1], c]
            m += 1
    for q in range(total):
        h = math.sqrt(out[q, 3] ** 2 + out[q, 4] ** 2 + out[q, 5] ** 2)
        if h > 0.0:
            for c in range(3, 6):
                out[q, c] /= h
    return out


@kernel
def slide(rows, target):
    """Move an open turn over to the next loop, evenly along its length.

    Args:
        rows: The turn, from its start on one loop, shape (n, c).
        target: The next loop, first row not repeated, shape (k, c).

    Returns:
        Rows that begin on the turn and end on the loop, shape (n, c).
    """
    n, width = rows.shape
    k = target.shape[0]
    total = max(line_length(rows, False), 1e-12)
    out = np.empty((n, width))
    walked = 0.0
    for q in range(n):
        if q > 0:
            walked += _gap(rows[q - 1], rows[q])
        u = walked / total
        _, segment, place = nearest_on(target, True, rows[q])
        after = (segment + 1) % k
        for c in range(width):
            b = (1.0 - place) * target[segment, c] + place * target[after, c]
            out[q, c] = (1.0 - u) * rows[q, c] + u * b
    return out
