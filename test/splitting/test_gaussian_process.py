# SPDX-License-Identifier: Apache-2.0
"""The regression against scikit-learn's, which it stands in for where time counts."""

import numpy as np
import pytest
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from vega_planner.splitting.gaussian_process import FIT_POINTS, GaussianProcess, spread


def border_samples(count=240, noise=0.2, seed=0):
    """Signed distances to a wavy border, with noise."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-10, 10, (count, 3))
    return points, points[:, 2] - 2 * np.sin(points[:, 0] / 4) + noise * rng.normal(size=count)


@pytest.mark.parametrize("seed", range(3))
def test_mean_and_deviation_are_those_of_scikit_learn(seed):
    points, values = border_samples(seed=seed)
    assert len(points) <= FIT_POINTS
    ours = GaussianProcess(points, values, np.array([4.0, 6.0, 9.0]))
    variance = ours._variance
    kernel = ConstantKernel(variance, "fixed") * RBF(ours.length, "fixed") + WhiteKernel(
        ours.noise**2, "fixed"
    )
    theirs = GaussianProcessRegressor(kernel, alpha=variance * 1e-9, optimizer=None)
    theirs.fit(points, values)
    at = np.random.default_rng(9).uniform(-12, 12, (200, 3))
    mean, deviation = theirs.predict(at, return_std=True)
    np.testing.assert_allclose(ours.mean(at), mean, atol=1e-7)
    np.testing.assert_allclose(
        np.hypot(ours.deviation(at), ours.noise), deviation, rtol=1e-5, atol=1e-7
    )


def test_the_chosen_scales_are_the_likeliest_of_those_tried():
    points, values = border_samples()
    lengths = np.array([1.0, 3.0, 6.0, 12.0])
    chosen = GaussianProcess(points, values, lengths)
    few = spread(points, 100)
    scores = []
    for length in lengths:
        best = -np.inf
        for ratio in (1e-4, 1e-3, 1e-2, 1e-1):
            kernel = np.exp(
                -0.5 * ((points[few][:, None] - points[few]) ** 2).sum(-1) / length**2
            ) + (ratio + 1e-9) * np.eye(len(few))
            y = values[few]
            variance = y @ np.linalg.solve(kernel, y) / len(y)
            sign, log_determinant = np.linalg.slogdet(kernel)
            assert sign > 0
            best = max(best, -0.5 * len(y) * np.log(variance) - 0.5 * log_determinant)
        scores.append(best)
    assert chosen.length == lengths[np.argmax(scores)]


def test_the_deviation_grows_away_from_the_samples():
    points, values = border_samples()
    process = GaussianProcess(points, values, np.array([6.0]))
    away = np.column_stack([np.linspace(10, 60, 20), np.zeros(20), np.zeros(20)])
    assert (np.diff(process.deviation(away)) >= -1e-9).all()
