# SPDX-License-Identifier: Apache-2.0
"""Morton's curve: an order of points in which neighbours in space come together."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Floats, Ints

BITS = 16


def morton_order(points: Floats) -> Ints:
    """Order points along Morton's curve through their bounding cube.

    Args:
        points: Points, shape (n, 3).

    Returns:
        Indices of the points in the order of the curve, shape (n,).
    """
    low = points.min(0)
    span = max(float(np.ptp(points, axis=0).max()), 1e-300)
    cells = ((points - low) / span * (2**BITS - 1)).astype(np.int64)
    key = np.zeros(len(points), dtype=np.int64)
    for bit in range(BITS):
        for axis in range(3):
            key |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return np.argsort(key, kind="stable")
