# SPDX-License-Identifier: Apache-2.0
"""Isolines against circles, and against their own definition."""

import numpy as np

from vega_planner.toolpaths.isolines import NORMAL, POSITION, isolines, off_levels, vertex_values
from vega_planner.toolpaths.polyline_kernels import line_length
from vega_planner.toolpaths.surface import connect


def _height_lines(make, spacing=1.0):
    patch = make.dome(20.0, 90.0, 20000)
    field = off_levels(patch.vertices[:, 2] / spacing)
    values = vertex_values(patch, spacing, patch.vertices[:, 2])
    return isolines(connect(patch), field, values, 100)


def test_lines_of_equal_height_on_a_dome_are_circles(make):
    lines = [line for line in _height_lines(make) if 0 < line.level < 19]
    assert [line.level for line in lines] == list(range(1, 19))
    for line in lines:
        radius = np.sqrt(400 - line.level**2)
        assert line.closed
        assert abs(line_length(line.rows, True) / (2 * np.pi * radius) - 1) < 5e-3
        assert np.abs(line.rows[:, 2] - line.level).max() < 1e-9


def test_higher_values_lie_to_the_left_of_a_line(make):
    for line in _height_lines(make)[1:-1]:
        along = np.diff(line.rows[:, POSITION], axis=0)
        left = np.cross(line.rows[:-1, NORMAL], along)
        assert (left[np.linalg.norm(along, axis=1) > 1e-6][:, 2] > 0).all()


def test_every_crossed_edge_is_on_exactly_one_line(make):
    patch = make.wavy(triangles=2000)
    surface = connect(patch)
    field = off_levels(3.3 * np.sin(patch.vertices[:, 0] / 3) * np.cos(patch.vertices[:, 1] / 4))
    values = vertex_values(patch, 1.0, field)
    lines = isolines(surface, np.maximum(field, -0.5), values, 3)
    a, b = np.maximum(field, -0.5)[surface.edges].T
    crossings = sum(int(((a < k) != (b < k)).sum()) for k in range(4))
    assert sum(len(line.rows) for line in lines) == crossings
