# SPDX-License-Identifier: Apache-2.0
"""Branch choice against brute force; insertion of poses; switching times."""

from __future__ import annotations

from itertools import product

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from vega_planner.robot.material import Material
from vega_planner.trajectory import branch_kernels
from vega_planner.trajectory.dispensing import SHORTEST_PAUSE_S, switching_times
from vega_planner.trajectory.waypoints import Waypoints, evenly_cut, refined, turned_evenly


@settings(deadline=None, derandomize=True, max_examples=60)
@given(st.integers(0, 10_000), st.integers(2, 6), st.integers(1, 4), st.floats(0.0, 5.0))
def test_viterbi_finds_what_brute_force_finds(seed, n, count, stiffness):
    rng = np.random.default_rng(seed)
    q = rng.uniform(-1, 1, (n, count, 3))
    valid = rng.random((n, count)) < 0.8
    valid[:, 0] = True
    cost = rng.random((n, count))
    velocity, allowed, jump = np.array([1.0, 2.0, 0.5]), np.full(n - 1, 0.8), rng.random(n - 1)
    choice = np.zeros(n, np.int64)
    endless = np.zeros(3, np.bool_)
    best = branch_kernels.cheapest_row(
        q, valid, cost, velocity, endless, allowed, jump, stiffness, choice
    )

    def price(row):
        total = sum(cost[i, c] for i, c in enumerate(row))
        for i in range(n - 1):
            time = (np.abs(q[i + 1, row[i + 1]] - q[i, row[i]]) / velocity).max()
            total += time + stiffness * time**2 + (jump[i] if time > 0.8 else 0.0)
        return total

    rows = [r for r in product(range(count), repeat=n) if valid[np.arange(n), list(r)].all()]
    assert abs(best - min(price(r) for r in rows)) < 1e-9
    assert abs(price(choice) - best) < 1e-9
    assert valid[np.arange(n), choice].all()


def test_unwinding_takes_the_shorter_way_at_every_step():
    turns = np.cumsum(np.full(200, 0.4))
    wrapped = np.column_stack([(turns + np.pi) % (2 * np.pi) - np.pi, turns])
    branch_kernels.unwind(wrapped, np.array([True, False]))
    np.testing.assert_allclose(np.diff(wrapped[:, 0]), 0.4, atol=1e-12)


@settings(deadline=None, derandomize=True)
@given(st.floats(-50, 50), st.floats(-6, 6))
def test_the_nearest_turn_is_within_limits_and_nearest(angle, guess):
    lower, upper = -7.0, 7.0
    x = branch_kernels._nearest_turn(angle, guess, lower, upper)
    turns = angle + 2 * np.pi * np.arange(-12, 13)
    inside = turns[(turns >= lower) & (turns <= upper)]
    assert abs((x - angle) / (2 * np.pi) - round((x - angle) / (2 * np.pi))) < 1e-9
    assert abs(x - guess) <= np.abs(inside - guess).min() + 1e-9


def a_way(n=12, seed=0):
    rng = np.random.default_rng(seed)
    points, axes = rng.normal(size=(n, 3)), rng.normal(size=(n, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    points[5] = points[4]
    axes[5] = axes[4]
    path = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    return Waypoints(points, axes, path, np.array([0, 5, n]), np.array([-1, 0]))


def test_inserted_poses_lie_on_the_chords_in_order():
    way = a_way()
    pieces = np.array([1, 3, 1, 2, 1, 4, 1, 1, 2, 5, 1])
    fine, place = refined(way, *evenly_cut(pieces))
    assert len(fine.points) == len(way.points) + (pieces - 1).sum()
    assert (np.diff(place) > 0).all()
    whole = place == np.floor(place)
    np.testing.assert_array_equal(fine.points[whole], way.points)
    assert fine.starts.tolist() == [0, 5 + 3, len(fine.points)]
    base = np.floor(place).astype(int)
    w = (place - base)[:, None]
    after = np.minimum(base + 1, 11)
    np.testing.assert_allclose(fine.points, (1 - w) * way.points[base] + w * way.points[after])
    np.testing.assert_allclose(np.linalg.norm(fine.axes, axis=1), 1.0)
    np.testing.assert_allclose(fine.path, np.interp(place, np.arange(12), way.path))


@settings(deadline=None, derandomize=True)
@given(st.integers(0, 1000), st.floats(0.0, 1.0))
def test_axes_turn_evenly(seed, share):
    a, b = np.random.default_rng(seed).normal(size=(2, 1, 3))
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    c = turned_evenly(a, b, np.array([share]))
    angle = np.arccos(np.clip(a @ b.T, -1, 1)).item()
    np.testing.assert_allclose(np.arccos(np.clip(a @ c.T, -1, 1)).item(), share * angle, atol=2e-7)


def material(lead, lag):
    return Material("clay", 100.0, 5.0, 0.84, 0.8, 1.2, lead_s=lead, lag_s=lag)


def test_switching_leads_and_lags_each_bead():
    times = switching_times(np.array([2.0, 10.0]), np.array([8.0, 15.0]), material(0.2, 0.1))
    np.testing.assert_allclose(times, [[1.8, 7.9], [9.8, 14.9]])


def test_switching_never_comes_before_the_start_or_leaves_a_bead_dry():
    times = switching_times(np.array([0.1]), np.array([0.3]), material(0.5, 1.0))
    np.testing.assert_allclose(times, [[0.0, 0.2]])


def test_pauses_too_short_for_the_valve_are_bridged():
    starts, ends = np.array([1.0, 2.0 + 0.5 * SHORTEST_PAUSE_S, 9.0]), np.array([2.0, 4.0, 12.0])
    times = switching_times(starts, ends, material(0.0, 0.0))
    np.testing.assert_allclose(times, [[1.0, 4.0], [9.0, 12.0]])
    assert switching_times(np.zeros(0), np.zeros(0), material(0, 0)).shape == (0, 2)
