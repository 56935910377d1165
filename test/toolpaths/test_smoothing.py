# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from vega_planner.toolpaths.smoothing_kernels import smooth_axes, without_crowding


def line(count=401, step=0.05, noise=0.0, seed=0):
    """A straight line whose axes lean more and more along it, with noise."""
    s = np.arange(count) * step
    lean = 0.3 * np.sin(s / 4)
    axes = np.column_stack([np.sin(lean), 0 * s, np.cos(lean)])
    axes += noise * np.random.default_rng(seed).normal(size=axes.shape)
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    return np.column_stack([s, 0 * s, 0 * s, axes])


def test_the_average_is_scipys_where_rows_are_even():
    rows = line(noise=0.05)
    ours = smooth_axes(rows, 3, 1.0, False)[:, 3:6]
    theirs = gaussian_filter1d(rows[:, 3:6], 1.0 / 0.05, axis=0, truncate=3.0)
    theirs /= np.linalg.norm(theirs, axis=1, keepdims=True)
    inner = slice(80, -80)
    # scipy and we may differ in the one weight at three deviations
    np.testing.assert_allclose(ours[inner], theirs[inner], atol=2e-4)
    np.testing.assert_allclose(np.linalg.norm(ours, axis=1), 1, atol=1e-12)


def test_points_stay_and_a_constant_axis_stays():
    rows = line()
    rows[:, 3:6] = [0.6, 0.0, 0.8]
    np.testing.assert_allclose(smooth_axes(rows, 3, 1.0, False), rows, atol=1e-12)


def test_a_loop_is_averaged_round_its_seam():
    turn = np.linspace(0, 2 * np.pi, 361)
    noise = 0.1 * np.random.default_rng(1).normal(size=360)
    lean = 0.4 + np.append(noise, noise[0])
    rows = np.column_stack(
        [8 * np.cos(turn), 8 * np.sin(turn), 0 * turn,
         np.sin(lean) * np.cos(turn), np.sin(lean) * np.sin(turn), np.cos(lean)]
    )  # fmt: skip
    smooth = smooth_axes(rows, 3, 1.0, True)
    np.testing.assert_allclose(smooth[0, 3:6], smooth[-1, 3:6], atol=1e-12)
    rolled = np.vstack([rows[120:-1], rows[:121]])
    again = smooth_axes(rolled, 3, 1.0, True)
    np.testing.assert_allclose(again[0, 3:6], smooth[120, 3:6], atol=1e-9)


@pytest.mark.parametrize("closed", [False, True])
def test_a_loop_without_length_is_left_as_it_is(closed):
    rows = np.zeros((3, 6))
    rows[:, 5] = 1.0
    np.testing.assert_array_equal(smooth_axes(rows, 3, 1.0, closed), rows)


def test_crowded_rows_go_and_both_ends_stay():
    rows = line(101, 0.01)
    kept = without_crowding(rows, 0.03)
    np.testing.assert_array_equal(kept[[0, -1]], rows[[0, -1]])
    gaps = np.linalg.norm(np.diff(kept[:, :3], axis=0), axis=1)
    assert gaps[:-1].min() >= 0.03 - 1e-12 and len(kept) <= 35
