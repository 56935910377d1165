# SPDX-License-Identifier: Apache-2.0
"""Fast marching on triangles with gradients carried along.

The plain method joins the ends of a front by a straight line, which costs an error of
the order of the edge length where fronts close in on a point. Here each vertex keeps
the direction its distance came from; along an edge the front is then a cubic, and the
error falls by one order. Fields carry a distance `d` and its gradient `g`.

Source: R. Kimmel, J. Sethian, Computing geodesic paths on manifolds, 1998; the
Hermite front is that of jet marching (S. Potter, M. Cameron, 2021).
"""

from __future__ import annotations

import heapq
import math

import numpy as np

from vega_planner.compiled import kernel

FAR = 1e300


@kernel
def edge_update(V, c, a, b, d, g, out):
    """Compute the distance at c of a front that passes through the edge a-b.

    Args:
        V: Vertices, shape (n, 3).
        c: Vertex to reach.
        a: First end of the edge, with distance and gradient.
        b: Second end.
        d: Distances, shape (n,).
        g: Gradients, shape (n, 3).
        out: Receives the gradient at c and the place on the edge, shape (4,).

    Returns:
        The distance at c.
    """
    ex = V[b, 0] - V[a, 0]
    ey = V[b, 1] - V[a, 1]
    ez = V[b, 2] - V[a, 2]
    px = V[c, 0] - V[a, 0]
    py = V[c, 1] - V[a, 1]
    pz = V[c, 2] - V[a, 2]
    L = math.sqrt(ex * ex + ey * ey + ez * ez)
    if L < 1e-12:
        L = 1e-12
    ex /= L
    ey /= L
    ez /= L
    x = px * ex + py * ey + pz * ez
    y2 = max(px * px + py * py + pz * pz - x * x, 0.0)
    da = d[a]
    db = d[b]
    ta = (g[a, 0] * ex + g[a, 1] * ey + g[a, 2] * ez) * L
    tb = (g[b, 0] * ex + g[b, 1] * ey + g[b, 2] * ez) * L
    agree = g[a, 0] * g[b, 0] + g[a, 1] * g[b, 1] + g[a, 2] * g[b, 2]
    slope = db - da
    if agree < 0.3:
        ta = slope
        tb = slope
    # cubic along the edge: da + ta w + q w^2 + r w^3, w in 0..1
    q = 3.0 * slope - 2.0 * ta - tb
    r = ta + tb - 2.0 * slope
    s = slope / L
    w = 0.0
    if abs(s) < 1.0:
        w = (x - math.sqrt(y2) * s / math.sqrt(1.0 - s * s)) / L
    elif s < 0.0:
        w = 1.0
    w = min(max(w, 0.0), 1.0)
    for _ in range(4):
        u = w * L - x
        rho = math.sqrt(u * u + y2)
        if rho < 1e-12:
            break
        first = ta + w * (2.0 * q + 3.0 * r * w) + L * u / rho
        second = 2.0 * q + 6.0 * r * w + L * L * y2 / (rho * rho * rho)
        if second < 0.2 * L * L * y2 / (rho * rho * rho):
            second = L * L * y2 / (rho * rho * rho)
        if second <= 0.0:
            break
        new = min(max(w - first / second, 0.0), 1.0)
        if abs(new - w) < 1e-9:
            w = new
            break
        w = new
    best = FAR
    where = w
    for k in range(3):
        v = w
        if k == 1:
            v = 0.0
        elif k == 2:
            v = 1.0
        u = v * L - x
        value = da + v * (ta + v * (q + v * r)) + math.sqrt(u * u + y2)
        if value < best - 1e-12:
            best = value
            where = v
    fx = px - where * L * ex
    fy = py - where * L * ey
    fz = pz - where * L * ez
    rho = math.sqrt(fx * fx + fy * fy + fz * fz)
    if rho > 1e-12:
        out[0] = fx / rho
        out[1] = fy / rho
        out[2] = fz / rho
    out[3] = where
    return best


@kernel
def _vertex_update(V, c, a, d, g, out):
    """Reach c from one vertex: along the edge, or with the plane front through a."""
    px = V[c, 0] - V[a, 0]
    py = V[c, 1] - V[a, 1]
    pz = V[c, 2] - V[a, 2]
    length = math.sqrt(px * px + py * py + pz * pz)
    if length < 1e-12:
        return d[a]
    out[0] = px / length
    out[1] = py / length
    out[2] = pz / length
    out[3] = 0.0
    return d[a] + length


@kernel
def march(V, F, offsets, star, d, g, carried, fixed, limit):
    """Extend distances from the vertices that have one to all that can be reached.

    Args:
        V: Vertices, shape (n, 3).
        F: Faces, shape (m, 3).
        offsets: Offsets of the vertex stars.
        star: Faces of the vertex stars.
        d: Distances, shape (n,): FAR where unknown; overwritten.
        g: Gradients, shape (n, 3); overwritten.
        carried: What each vertex has from the place its distance starts at, shape
            (n, c); overwritten.
        fixed: True where d, g and what is carried are given and stay.
        limit: Distances above it are left as they are.

    Returns:
        Vertices in the order the front reached them.
    """
    count = V.shape[0]
    done = np.zeros(count, np.bool_)
    order = np.empty(count, np.int64)
    reached = 0
    out = np.zeros(4)
    heap = [(0.0, np.int64(0))]
    heap.pop()
    for v in range(count):
        if d[v] < FAR:
            heapq.heappush(heap, (d[v], np.int64(v)))
    while len(heap) > 0:
        value, i = heapq.heappop(heap)
        if done[i] or value > d[i]:
            continue
        done[i] = True
        order[reached] = i
        reached += 1
        if value > limit:
            break
        for s in range(offsets[i], offsets[i + 1]):
            t = star[s]
            a = F[t, 0]
            b = F[t, 1]
            c = F[t, 2]
            if b == i:
                a, b, c = b, c, a
            elif c == i:
                a, b, c = c, a, b
            for k in range(2):
                p = b if k == 0 else c
                o = c if k == 0 else b
                if done[p] or fixed[p]:
                    continue
                if done[o]:
                    new = edge_update(V, p, a, o, d, g, out)
                else:
                    new = _vertex_update(V, p, a, d, g, out)
                if new < d[p] - 1e-12:
                    d[p] = new
                    for m in range(3):
                        g[p, m] = out[m]
                    for m in range(carried.shape[1]):
                        carried[p, m] = (1.0 - out[3]) * carried[a, m] + out[3] * carried[o, m]
                    heapq.heappush(heap, (new, p))
    # One sweep in the order of arrival: now both ends of every edge are known, which
    # mends vertices that an obtuse triangle let the front reach too late.
    best_g = np.zeros(4)
    left = right = 0
    for q in range(reached):
        p = order[q]
        if fixed[p]:
            continue
        best = FAR
        for s in range(offsets[p], offsets[p + 1]):
            t = star[s]
            a = F[t, 0]
            b = F[t, 1]
            c = F[t, 2]
            if b == p:
                a, b, c = b, c, a
            elif c == p:
                a, b, c = c, a, b
            if d[b] >= FAR or d[c] >= FAR or (d[b] > d[p] and d[c] > d[p]):
                continue
            new = edge_update(V, p, b, c, d, g, out)
            if new < best:
                best = new
                left = b
                right = c
                for m in range(4):
                    best_g[m] = out[m]
        if best < FAR:
            d[p] = best
            for m in range(carried.shape[1]):
                carried[p, m] = (1.0 - best_g[3]) * carried[left, m] + best_g[3] * carried[
                    right, m
                ]
            for m in range(3):
                g[p, m] = best_g[m]
    return order[:reached].copy()


@kernel
def _to_segment(p, a, b, foot, beyond):
    """Distance of p from the segment a-b; `foot` receives the nearest point.

    The segment goes on `beyond` its ends by that part of its length.
    """
    dx = b[0] - a[0]
    dy = b[1] - a[1]
    dz = b[2] - a[2]
    ll = dx * dx + dy * dy + dz * dz
    w = 0.0
    if ll > 0.0:
        w = ((p[0] - a[0]) * dx + (p[1] - a[1]) * dy + (p[2] - a[2]) * dz) / ll
        w = min(max(w, -beyond), 1.0 + beyond)
    foot[0] = a[0] + w * dx
    foot[1] = a[1] + w * dy
    foot[2] = a[2] + w * dz
    return math.sqrt((p[0] - foot[0]) ** 2 + (p[1] - foot[1]) ** 2 + (p[2] - foot[2]) ** 2), w


@kernel
def start_at_rim(V, F, offsets, star, rim, d, g, carried, fixed):
    """Set distance and gradient at the vertices next to the rim.

    Args:
        V: Vertices, shape (n, 3).
        F: Faces, shape (m, 3).
        offsets: Offsets of the vertex stars.
        star: Faces of the vertex stars.
        rim: Rim edges, shape (r, 2), running as their face does.
        d: Distances, FAR everywhere; overwritten.
        g: Gradients; overwritten.
        carried: What the rim vertices carry, shape (n, c); overwritten next to the rim.
        fixed: False everywhere; overwritten.
    """
    count = V.shape[0]
    after = np.full(count, -1, np.int64)
    before = np.full(count, -1, np.int64)
    for e in range(rim.shape[0]):
        after[rim[e, 0]] = rim[e, 1]
        before[rim[e, 1]] = rim[e, 0]
    foot = np.zeros(3)
    for e in range(rim.shape[0]):
        for k in range(2):
            v = rim[e, k]
            d[v] = 0.0
            fixed[v] = True
    # inward direction in the surface at the rim vertices
    for e in range(rim.shape[0]):
        i = rim[e, 0]
        j = rim[e, 1]
        for s in range(offsets[i], offsets[i + 1]):
            t = star[s]
            for c in range(3):
                if F[t, c] == i and F[t, (c + 1) % 3] == j:
                    k = F[t, (c + 2) % 3]
                    _to_segment(V[k], V[i], V[j], foot, 1e6)
                    h = math.sqrt(
                        (V[k, 0] - foot[0]) ** 2
                        + (V[k, 1] - foot[1]) ** 2
                        + (V[k, 2] - foot[2]) ** 2
                    )
                    if h > 1e-12:
                        for m in range(3):
                            g[i, m] += (V[k, m] - foot[m]) / h
                            g[j, m] += (V[k, m] - foot[m]) / h
    for e in range(rim.shape[0]):
        v = rim[e, 0]
        h = math.sqrt(g[v, 0] ** 2 + g[v, 1] ** 2 + g[v, 2] ** 2)
        if h > 1e-12:
            for m in range(3):
                g[v, m] /= h
    for e in range(rim.shape[0]):
        i = rim[e, 0]
        for s in range(offsets[i], offsets[i + 1]):
            t = star[s]
            for c in range(3):
                v = F[t, c]
                if after[v] >= 0 or before[v] >= 0:
                    continue
                for direction in range(2):
                    a = i
                    for _ in range(3):
                        b = after[a] if direction == 0 else before[a]
                        if b < 0:
                            break
                        x, w = _to_segment(V[v], V[a], V[b], foot, 0.0)
                        if x < d[v]:
                            d[v] = x
                            fixed[v] = True
                            for m in range(carried.shape[1]):
                                carried[v, m] = (1.0 - w) * carried[a, m] + w * carried[b, m]
                            if x > 1e-12:
                                for m in range(3):
                                    g[v, m] = (V[v, m] - foot[m]) / x
                        a = b


@kernel
def start_at_zero(V, F, f, d, g, fixed):
    """Set distances to the zero line of a vertex field in the faces it crosses.

    Args:
        V: Vertices, shape (n, 3).
        F: Faces, shape (m, 3).
        f: The field, shape (n,); zeros must have been moved aside.
        d: Distances, FAR everywhere; overwritten.
        g: Gradients, away from the line; overwritten.
        fixed: False everywhere; overwritten.
    """
    ends = np.zeros((2, 3))
    foot = np.zeros(3)
    for t in range(F.shape[0]):
        k = 0
        for c in range(3):
            i = F[t, c]
            j = F[t, (c + 1) % 3]
            if (f[i] < 0.0) != (f[j] < 0.0) and k < 2:
                w = f[i] / (f[i] - f[j])
                for m in range(3):
                    ends[k, m] = V[i, m] + w * (V[j, m] - V[i, m])
                k += 1
        if k < 2:
            continue
        ll = 0.0
        for m in range(3):
            ll += (ends[1, m] - ends[0, m]) ** 2
        for c in range(3):
            v = F[t, c]
            x, w = _to_segment(V[v], ends[0], ends[1], foot, 1e6)
            if x < d[v]:
                d[v] = x
                fixed[v] = True
                if x > 1e-9:
                    for m in range(3):
                        g[v, m] = (V[v, m] - foot[m]) / x


@kernel
def start_at_vertex(V, F, offsets, star, source, d, g, fixed):
    """Set the straight distances from one vertex to its neighbours.

    Args:
        V: Vertices, shape (n, 3).
        F: Faces, shape (m, 3).
        offsets: Offsets of the vertex stars.
        star: Faces of the vertex stars.
        source: The vertex.
        d: Distances; overwritten near the source.
        g: Gradients; overwritten near the source.
        fixed: Set near the source.
    """
    for s in range(offsets[source], offsets[source + 1]):
        for c in range(3):
            v = F[star[s], c]
            x = math.sqrt(
                (V[v, 0] - V[source, 0]) ** 2
                + (V[v, 1] - V[source, 1]) ** 2
                + (V[v, 2] - V[source, 2]) ** 2
            )
            if x < d[v]:
                d[v] = x
                fixed[v] = True
                if x > 1e-12:
                    for m in range(3):
                        g[v, m] = (V[v, m] - V[source, m]) / x
