# SPDX-License-Identifier: Apache-2.0
"""The time law against toppra and against what can be worked out by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vega_planner.trajectory.time_law import time_segment


def wavy_path(count, seed):
    """A smooth joint path of five joints over one metre."""
    rng = np.random.default_rng(seed)
    s = np.linspace(0.0, 1.0, count)
    waves = rng.uniform(1, 6, (3, 5)), rng.uniform(0, 6, (3, 5)), rng.uniform(0.05, 0.4, (3, 5))
    q = sum(a * np.sin(2 * np.pi * f * s[:, None] + p) for f, p, a in zip(*waves))
    return s, q


def toppra_duration(s, q, speed, velocity, acceleration):
    """Duration by toppra on the same grid, the path's speed as one more joint."""
    import toppra
    import toppra.algorithm
    import toppra.constraint

    rows = np.column_stack([q, s])
    path = toppra.SplineInterpolator(s, rows)
    fastest = np.append(velocity, speed)
    hardest = np.append(acceleration, 1e3)
    constraints = [
        toppra.constraint.JointVelocityConstraint(np.column_stack([-fastest, fastest])),
        toppra.constraint.JointAccelerationConstraint(np.column_stack([-hardest, hardest])),
    ]
    algorithm = toppra.algorithm.TOPPRA(
        constraints, path, gridpoints=s, parametrizer="ParametrizeConstAccel"
    )
    return float(algorithm.compute_trajectory(0, 0).duration)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("speed", [0.02, 0.5, 50.0])
def test_durations_agree_with_toppra_within_a_tenth_of_a_percent(seed, speed):
    """Bound by the tip's speed, by both, and by the joints alone."""
    s, q = wavy_path(3000, seed)
    velocity, acceleration = np.full(5, 3.0), np.full(5, 20.0)
    times, _, _ = time_segment(
        s, q, np.full(len(s), speed), velocity, np.tile(acceleration, (len(s), 1))
    )
    reference = toppra_duration(s, q, speed, velocity, acceleration)
    assert times[-1] == pytest.approx(reference, rel=1e-3)


def test_one_joint_from_rest_to_rest_follows_the_bang_bang_law():
    """t = 2 sqrt(L / a) without a speed limit, L / v + v / a with one."""
    s = np.linspace(0.0, 1.0, 2001)
    q = s[:, None]
    acceleration = np.full((len(s), 1), 2.0)
    free, _, _ = time_segment(s, q, np.full(len(s), 1e3), np.array([1e3]), acceleration)
    assert free[-1] == pytest.approx(2 * np.sqrt(1 / 2.0), rel=1e-3)
    bound, _, _ = time_segment(s, q, np.full(len(s), 1e3), np.array([0.5]), acceleration)
    assert bound[-1] == pytest.approx(1 / 0.5 + 0.5 / 2.0, rel=1e-3)


@settings(deadline=None, derandomize=True, max_examples=40)
@given(
    st.integers(0, 10_000),
    st.floats(0.01, 20.0),
    st.floats(0.1, 10.0),
    st.floats(0.5, 100.0),
    st.integers(3, 400),
)
def test_velocities_and_accelerations_keep_their_limits(seed, speed, fastest, hardest, count):
    s, q = wavy_path(count, seed)
    velocity, acceleration = np.full(5, fastest), np.full((count, 5), hardest)
    times, rates, speeds = time_segment(s, q, np.full(count, speed), velocity, acceleration)
    assert (np.diff(times) > 0).all()
    assert (speeds <= speed * (1 + 1e-9)).all()
    assert (np.abs(rates) <= fastest * (1 + 1e-9)).all()
    assert speeds[0] == speeds[-1] == 0.0
    h = np.diff(times)[:, None]
    change = np.diff(np.diff(q, axis=0) / h, axis=0) / (0.5 * (h[1:] + h[:-1]))
    # between even accelerations the second difference is their mean, with the path's own
    # curvature; coarse grids carry an error of their order
    if count > 200:
        assert np.abs(change).max() <= hardest * 1.35


@settings(deadline=None, derandomize=True, max_examples=25)
@given(st.integers(0, 10_000), st.floats(1.1, 5.0))
def test_looser_limits_never_take_longer(seed, factor):
    s, q = wavy_path(500, seed)
    speed = np.full(500, 1.0)
    tight, _, _ = time_segment(s, q, speed, np.full(5, 1.0), np.full((500, 5), 5.0))
    loose, _, _ = time_segment(s, q, speed, np.full(5, factor), np.full((500, 5), 5.0 * factor))
    assert loose[-1] <= tight[-1] * (1 + 1e-9)


def test_time_scales_with_the_limits():
    """Twice the speeds and four times the accelerations halve the time."""
    s, q = wavy_path(800, 3)
    slow, _, _ = time_segment(s, q, np.full(800, 0.4), np.full(5, 2.0), np.full((800, 5), 9.0))
    fast, _, _ = time_segment(s, q, np.full(800, 0.8), np.full(5, 4.0), np.full((800, 5), 36.0))
    assert fast[-1] == pytest.approx(slow[-1] / 2, rel=1e-9)
