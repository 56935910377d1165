# SPDX-License-Identifier: Apache-2.0
"""Drawn triangles against every pixel asked one by one."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from vega_planner.viewer import raster_kernels as kernels

_corner = st.tuples(st.integers(-20, 120), st.integers(-20, 90), st.integers(0, 9))
_side = st.tuples(st.integers(-6, 6), st.integers(-6, 6))


@settings(deadline=None, derandomize=True, max_examples=200)
@given(
    _corner, _corner, st.tuples(st.integers(-6, 6), st.integers(-6, 6)), st.sampled_from([1, 4])
)
def test_a_triangle_covers_the_pixels_whose_middles_lie_in_it(tip, base, side, finer):
    """Needles, flat edges and corners outside the picture among them."""
    end = (base[0] + side[0], base[1] + side[1], base[2])
    points = np.array([tip, base, end]) / finer
    image = np.zeros((70, 100, 3), np.float32)
    depth = np.full((70, 100), -np.inf, np.float32)
    colours = np.full((3, 3), 200.0, np.float32)
    kernels.draw_triangles(
        image, depth, points, np.array([[0, 1, 2]]), colours, np.array([-0.35, -0.55, 0.76])
    )
    (ux, uy), (vx, vy) = (points[1:] - points[0])[:, :2]
    twice = ux * vy - uy * vx
    expected = np.zeros((70, 100), bool)
    if twice:
        y, x = np.mgrid[:70, :100] + 0.5
        x, y = x - points[0, 0], y - points[0, 1]
        s, t = (x * vy - y * vx) * (1.0 / twice), (ux * y - uy * x) * (1.0 / twice)
        expected = (s >= 0) & (t >= 0) & (s + t <= 1)
    assert (np.isfinite(depth) == expected).all()
