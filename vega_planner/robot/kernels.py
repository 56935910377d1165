# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Compiled kinematics of a serial chain: forward map, Jacobian, Levenberg-Marquardt.

A chain of n joints is the tuple `(rotations (n, 3, 3), offsets (n, 3), axes (n, 3),
revolute (n,), tip (3,), tip_axes (2, 3))`, see `chain.Chain.arrays`: joint i turns about
(or slides along) `axes[i]` of the frame that stands at `offsets[i]`, turned by
`rotations[i]`, in the frame behind joint i - 1. `tip_axes` are the nozzle's axis and a
unit vector square to it, in the last frame. Lengths are metres, angles radians.

A target is a point and the nozzle's axis; the turn about the axis is free, or set by a
second unit vector square to it.
"""

from __future__ import annotations

import math

import numpy as np

from vega_planner.compiled import kernel

#: Length that weighs a metre of position error against a radian of axis error.
LENGTH = 0.1


#: Squared distance of targets, lengths over LENGTH, within which one's solution seeds the other.
NEAR_TARGET = 0.1


@kernel(inline="always")
def apply(r, v):
    """Turn a vector by a rotation, nine numbers by rows."""
    return (
        r[0] * v[0] + r[1] * v[1] + r[2] * v[2],
        r[3] * v[0] + r[4] * v[1] + r[5] * v[2],
        r[6] * v[0] + r[7] * v[1] + r[8] * v[2],
    )


@kernel(inline="always")
def composed(r, m):
    """Product of a rotation, nine numbers, with a matrix (3, 3)."""
    return (
        r[0] * m[0, 0] + r[1] * m[1, 0] + r[2] * m[2, 0],
        r[0] * m[0, 1] + r[1] * m[1, 1] + r[2] * m[2, 1],
        r[0] * m[0, 2] + r[1] * m[1, 2] + r[2] * m[2, 2],
        r[3] * m[0, 0] + r[4] * m[1, 0] + r[5] * m[2, 0],
        r[3] * m[0, 1] + r[4] * m[1, 1] + r[5] * m[2, 1],
        r[3] * m[0, 2] + r[4] * m[1, 2] + r[5] * m[2, 2],
        r[6] * m[0, 0] + r[7] * m[1, 0] + r[8] * m[2, 0],
        r[6] * m[0, 1] + r[7] * m[1, 1] + r[8] * m[2, 1],
        r[6] * m[0, 2] + r[7] * m[1, 2] + r[8] * m[2, 2],
    )


@kernel(inline="always")
def turned(r, axis, angle):
    """Product of a rotation with Rodrigues' rotation about a unit axis."""
    c = math.cos(angle)
    s = math.sin(angle)
    v = 1.0 - c
    x, y, z = axis[0], axis[1], axis[2]
    m0, m1, m2 = c + x * x * v, x * y * v - z * s, x * z * v + y * s
    m3, m4, m5 = y * x * v + z * s, c + y * y * v, y * z * v - x * s
    m6, m7, m8 = z * x * v - y * s, z * y * v + x * s, c + z * z * v
    return (
        r[0] * m0 + r[1] * m3 + r[2] * m6,
        r[0] * m1 + r[1] * m4 + r[2] * m7,
        r[0] * m2 + r[1] * m5 + r[2] * m8,
        r[3] * m0 + r[4] * m3 + r[5] * m6,
        r[3] * m1 + r[4] * m4 + r[5] * m7,
        r[3] * m2 + r[4] * m5 + r[5] * m8,
        r[6] * m0 + r[7] * m3 + r[8] * m6,
        r[6] * m1 + r[7] * m4 + r[8] * m7,
        r[6] * m2 + r[7] * m5 + r[8] * m8,
    )


@kernel
def forward_one(chain, q, tip, axes, world_axes, centres):
    """Forward kinematics of one configuration, with each joint's axis and a point on it."""
    rotations, offsets, joint_axes, revolute, tip_offset, tip_axes = chain
    r = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    px, py, pz = 0.0, 0.0, 0.0
    for i in range(q.shape[0]):
        d = apply(r, offsets[i])
        px += d[0]
        py += d[1]
        pz += d[2]
        r = composed(r, rotations[i])
        a = apply(r, joint_axes[i])
        world_axes[i, 0], world_axes[i, 1], world_axes[i, 2] = a
        if revolute[i]:
            r = turned(r, joint_axes[i], q[i])
        else:
            px += a[0] * q[i]
            py += a[1] * q[i]
            pz += a[2] * q[i]
        centres[i, 0], centres[i, 1], centres[i, 2] = px, py, pz
    d = apply(r, tip_offset)
    tip[0], tip[1], tip[2] = px + d[0], py + d[1], pz + d[2]
    axes[0, 0], axes[0, 1], axes[0, 2] = apply(r, tip_axes[0])
    axes[1, 0], axes[1, 1], axes[1, 2] = apply(r, tip_axes[1])


@kernel
def forward_many(chain, q, points, axes, sides):
    """Forward kinematics of configurations (n, j) into points, axes and sides (n, 3)."""
    n, joints = q.shape
    world = np.zeros((joints, 3))
    centres = np.zeros((joints, 3))
    tip = np.zeros(3)
    frame = np.zeros((2, 3))
    for i in range(n):
        forward_one(chain, q[i], tip, frame, world, centres)
        points[i] = tip
        axes[i] = frame[0]
        sides[i] = frame[1]


@kernel
def jacobian_one(revolute, tip, world_axes, centres, jacobian):
    """Geometric Jacobian: rows 0-2 the tip's velocity, rows 3-5 the angular velocity."""
    for i in range(world_axes.shape[0]):
        ax, ay, az = world_axes[i, 0], world_axes[i, 1], world_axes[i, 2]
        if revolute[i]:
            dx = tip[0] - centres[i, 0]
            dy = tip[1] - centres[i, 1]
            dz = tip[2] - centres[i, 2]
            jacobian[0, i] = ay * dz - az * dy
            jacobian[1, i] = az * dx - ax * dz
            jacobian[2, i] = ax * dy - ay * dx
            jacobian[3, i], jacobian[4, i], jacobian[5, i] = ax, ay, az
        else:
            jacobian[0, i], jacobian[1, i], jacobian[2, i] = ax, ay, az
            jacobian[3, i], jacobian[4, i], jacobian[5, i] = 0.0, 0.0, 0.0


@kernel
def _axis_error(u, target, e):
    """Rotation vector of the shortest turn of u onto target, into e[3:6]."""
    cx = u[1] * target[2] - u[2] * target[1]
    cy = u[2] * target[0] - u[0] * target[2]
    cz = u[0] * target[1] - u[1] * target[0]
    s = math.sqrt(cx * cx + cy * cy + cz * cz)
    c = u[0] * target[0] + u[1] * target[1] + u[2] * target[2]
    factor = 1.0
    if s > 1e-12:
        factor = math.atan2(s, c) / s
    elif c < 0:  # antiparallel: the cross product has a false zero here; any turn will do
        if abs(u[0]) < 0.9:
            cx, cy, cz = 0.0, u[2], -u[1]
        else:
            cx, cy, cz = -u[2], 0.0, u[0]
        factor = math.pi / math.sqrt(cx * cx + cy * cy + cz * cz)
    e[3], e[4], e[5] = factor * cx, factor * cy, factor * cz


@kernel
def _frame_error(u, x, axis, side, e):
    """Rotation vector of the turn of the frame (u, x) onto (axis, side), into e[3:6]."""
    y0, y1, y2 = (
        u[1] * x[2] - u[2] * x[1],
        u[2] * x[0] - u[0] * x[2],
        u[0] * x[1] - u[1] * x[0],
    )
    t0, t1, t2 = (
        axis[1] * side[2] - axis[2] * side[1],
        axis[2] * side[0] - axis[0] * side[2],
        axis[0] * side[1] - axis[1] * side[0],
    )
    sx = u[1] * axis[2] - u[2] * axis[1] + x[1] * side[2] - x[2] * side[1] + y1 * t2 - y2 * t1
    sy = u[2] * axis[0] - u[0] * axis[2] + x[2] * side[0] - x[0] * side[2] + y2 * t0 - y0 * t2
    sz = u[0] * axis[1] - u[1] * axis[0] + x[0] * side[1] - x[1] * side[0] + y0 * t1 - y1 * t0
    trace = u[0] * axis[0] + u[1] * axis[1] + u[2] * axis[2]
    trace += x[0] * side[0] + x[1] * side[1] + x[2] * side[2] + y0 * t0 + y1 * t1 + y2 * t2
    s = 0.5 * math.sqrt(sx * sx + sy * sy + sz * sz)
    angle = math.atan2(s, 0.5 * (trace - 1.0))
    factor = 0.5 if s < 1e-9 else 0.5 * angle / s
    e[3], e[4], e[5] = factor * sx, factor * sy, factor * sz


@kernel
def solve_one(chain, lower, upper, point, axis, side, q, tolerance, limit, work):
    """Levenberg-Marquardt from q to one target, within the joint limits.

    `side` of length 0 leaves the turn about the axis free, `axis` of length 0 leaves the
    whole orientation free. `work` is made by `workspace`.
    Damping is adaptive and scaled by the diagonal: with a fixed tiny damping some wrists
    stall at their singularity. Steps are cut to one radian and clamped to the limits.

    Returns the number of iterations, negative where it failed; q holds the best found.
    """
    jacobian, world, centres, hessian, vectors, tip, frame, e = work
    revolute = chain[3]
    n = q.shape[0]
    gradient, trial, step = vectors[0], vectors[1], vectors[2]
    framed = side.shape[0] == 3
    damping = 1e-6
    best = 1e300
    for k in range(n):
        trial[k] = min(max(q[k], lower[k]), upper[k])
    for iteration in range(limit):
        forward_one(chain, trial, tip, frame, world, centres)
        for k in range(3):
            e[k] = (point[k] - tip[k]) / LENGTH
        if framed:
            _frame_error(frame[0], frame[1], axis, side, e)
        elif axis.shape[0] == 3:
            _axis_error(frame[0], axis, e)
        error = 0.0
        for k in range(6):
            error += e[k] * e[k]
        if error < best:
            best = error
            for k in range(n):
                q[k] = trial[k]
            if error < tolerance * tolerance:
                return iteration + 1
            damping = max(damping * 0.1, 1e-12)
            jacobian_one(revolute, tip, world, centres, jacobian)
            u = frame[0]
            for i in range(n):
                if axis.shape[0] == 0:
                    jacobian[3:, i] = 0.0
                elif not framed:  # turning about the nozzle changes nothing
                    spin = jacobian[3, i] * u[0] + jacobian[4, i] * u[1] + jacobian[5, i] * u[2]
                    for k in range(3):
                        jacobian[3 + k, i] -= spin * u[k]
                for k in range(3):
                    jacobian[k, i] /= LENGTH
            for i in range(n):
                total = 0.0
                for k in range(6):
                    total += jacobian[k, i] * e[k]
                gradient[i] = total
                for j in range(i + 1):
                    total = 0.0
                    for k in range(6):
                        total += jacobian[k, i] * jacobian[k, j]
                    hessian[i, j] = total  # lower triangle; the factor goes to the upper one
        else:
            damping *= 10.0
            if damping > 1e6:
                return -iteration - 1
        _damped_step(hessian, gradient, damping, step, vectors[3])
        largest = 0.0
        for k in range(n):
            if revolute[k]:
                largest = max(largest, abs(step[k]))
        scale = 1.0 if largest < 1.0 else 1.0 / largest
        for k in range(n):
            trial[k] = min(max(q[k] + scale * step[k], lower[k]), upper[k])
    return -limit


@kernel
def _damped_step(hessian, gradient, damping, step, diagonal):
    """Solve (H + damping (1 + diag H)) step = gradient by Cholesky's factorisation."""
    n = gradient.shape[0]
    for i in range(n):
        for j in range(i + 1):
            total = hessian[i, j]
            if i == j:
                total += damping * (1.0 + hessian[i, i]) + 1e-14
            for k in range(j):
                total -= hessian[k, i] * (hessian[k, j] if k < j else 0.0)
            if i == j:
                diagonal[i] = math.sqrt(max(total, 1e-18))
            else:
                hessian[j, i] = total / diagonal[j]
    for i in range(n):
        total = gradient[i]
        for k in range(i):
            total -= hessian[k, i] * step[k]
        step[i] = total / diagonal[i]
    for i in range(n - 1, -1, -1):
        total = step[i]
        for k in range(i + 1, n):
            total -= hessian[i, k] * step[k]
        step[i] = total / diagonal[i]


@kernel
def workspace(n):
    """Scratch arrays of `solve_one` for a chain of n joints."""
    return (
        np.zeros((6, n)),
        np.zeros((n, 3)),
        np.zeros((n, 3)),
        np.zeros((n, n)),
        np.zeros((4, n)),
        np.zeros(3),
        np.zeros((2, 3)),
        np.zeros(6),
    )


@kernel
def solve_seeded(chain, lower, upper, points, axes, seeds, tolerance, limit, q, found):
    """Solve each target from the last solution, then from its own seeds (n, k, j) in turn.

    `axes` without rows leaves the orientation free.
    """
    n, joints = q.shape
    work = workspace(joints)
    free = np.zeros(0)
    last = -1
    trial = np.zeros(joints)
    for i in range(n):
        found[i] = False
        axis = axes[i] if axes.shape[0] == n else free
        # the last solution is a good seed where the targets lie close together
        near = last >= 0
        if near:
            gap = 0.0
            for k in range(3):
                gap += ((points[i, k] - points[last, k]) / LENGTH) ** 2
                if axes.shape[0] == n:
                    gap += (axes[i, k] - axes[last, k]) ** 2
            near = gap < NEAR_TARGET
        for s in range(-1, seeds.shape[1]):
            if s < 0:
                if not near:
                    continue
                trial[:] = q[last]
            else:
                trial[:] = seeds[i, s]
            steps = solve_one(
                chain, lower, upper, points[i], axis, free, trial, tolerance, limit, work
            )
            if steps > 0:
                found[i] = True
                q[i] = trial
                last = i
                break


@kernel
def solve_each(chain, lower, upper, points, axes, guesses, tolerance, limit, q, found):
    """Solve each target from its own guess (n, j)."""
    n, joints = q.shape
    work = workspace(joints)
    trial = np.zeros(joints)
    free = np.zeros(0)
    for i in range(n):
        trial[:] = guesses[i]
        steps = solve_one(
            chain, lower, upper, points[i], axes[i], free, trial, tolerance, limit, work
        )
        found[i] = steps > 0
        q[i] = trial
