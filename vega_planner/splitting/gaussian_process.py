# SPDX-License-Identifier: Apache-2.0
"""Gaussian-process regression with an RBF kernel and white noise, small and exact.

Hyper-parameters are chosen on a grid by the marginal likelihood with the amplitude
profiled out, on few points that are spread evenly; the fit then takes more of them. The
cost is cubic in the number of points, and a smooth border needs few.

Source:
    Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, algorithm 2.1.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_solve, cholesky, solve_triangular

from vega_planner.datatypes import Floats, Ints
from vega_planner.splitting.kernels import spread_points, squared_distances

#: White noise tried, as a share of the amplitude's variance.
NOISE_RATIOS = (1e-4, 1e-3, 1e-2, 1e-1)

#: Points of the search for hyper-parameters, and of the fit.
SEARCH_POINTS, FIT_POINTS = 100, 320


class GaussianProcess:
    """A fitted regression of one value over points in space.

    Args:
        points: Where the value is known [mm], shape (n, 3).
        values: The value there, shape (n,).
        lengths: Length scales tried [mm].

    Attributes:
        length: Chosen length scale [mm].
        noise: Chosen standard deviation of the noise.
    """

    def __init__(self, points: Floats, values: Floats, lengths: Floats) -> None:
        few = spread(points, SEARCH_POINTS)
        square = _squares(points[few], points[few])
        y = values[few]
        best = np.inf
        for length in lengths:
            kernel = np.exp(-0.5 * square / length**2)
            for ratio in NOISE_RATIOS:
                lower = cholesky(
                    kernel + (ratio + 1e-9) * np.eye(len(y)), lower=True, check_finite=False
                )
                white = solve_triangular(lower, y, lower=True, check_finite=False)
                variance = max(float(white @ white) / len(y), 1e-30)
                cost = 0.5 * len(y) * np.log(variance) + np.log(np.diag(lower)).sum()
                if cost < best:
                    best = cost
                    self.length, self._ratio, self._variance = float(length), ratio, variance
        many = spread(points, FIT_POINTS)
        self._points = np.ascontiguousarray(points[many])
        kernel = np.exp(-0.5 * _squares(self._points, self._points) / self.length**2)
        self._lower = cholesky(kernel + (self._ratio + 1e-9) * np.eye(len(many)), lower=True)
        self._weights = cho_solve((self._lower, True), values[many])
        self.noise = float(np.sqrt(self._ratio * self._variance))

    def mean(self, points: Floats) -> Floats:
        """Predict the value at points, shape (n,)."""
        return np.exp(-0.5 * _squares(points, self._points) / self.length**2) @ self._weights

    def deviation(self, points: Floats) -> Floats:
        """Predict the standard deviation of the mean at points, shape (n,)."""
        cross = np.exp(-0.5 * _squares(points, self._points) / self.length**2)
        white = solve_triangular(self._lower, cross.T, lower=True, check_finite=False)
        left = np.maximum(1.0 - np.einsum("ij,ij->j", white, white), 0.0)
        return np.sqrt(self._variance * left)


def spread(points: Floats, count: int) -> Ints:
    """Pick points far from each other: each next one is the farthest from those before.

    Returns:
        Indices, at most `count`, the first one 0.
    """
    out = np.zeros(min(count, len(points)), np.int64)
    spread_points(np.ascontiguousarray(points), out)
    return out


def _squares(a: Floats, b: Floats) -> Floats:
    out = np.empty((len(a), len(b)))
    squared_distances(np.ascontiguousarray(a), np.ascontiguousarray(b), out)
    return out
