# SPDX-License-Identifier: Apache-2.0
"""Distance fields against what geometry says."""

import numpy as np
import pytest

from vega_planner.toolpaths.distance import from_guide, from_rim
from vega_planner.toolpaths.surface import connect


def _rim_error(make, triangles):
    patch = make.dome(20.0, 80.0, triangles)
    distance, gradient, _ = from_rim(connect(patch))
    height = patch.vertices[:, 2] + 20 * np.cos(np.radians(80.0))
    polar = np.arccos(np.clip(height / 20, -1, 1))
    return np.abs(distance - 20 * (np.radians(80.0) - polar)), gradient


def test_distance_from_the_rim_of_a_dome_is_the_arc_length(make):
    error, gradient = _rim_error(make, 20000)
    assert error.mean() < 0.002
    assert error.max() < 0.03
    assert np.abs(np.linalg.norm(gradient, axis=1) - 1).max() < 1e-9


def test_distance_from_the_rim_converges_faster_than_the_edges_shrink(make):
    coarse, fine = _rim_error(make, 2000)[0].mean(), _rim_error(make, 32000)[0].mean()
    # edges are four times shorter; a first-order method would only gain a factor of 4
    assert coarse / fine > 8


def test_distance_on_a_flat_sheet_from_a_straight_guide_is_exact(make):
    patch = make.wavy(amplitude=0.0, triangles=4000)
    guide = patch.vertices[:, 0] + 0.3 * patch.vertices[:, 1] - 1.234
    distance = from_guide(connect(patch), guide)
    inside = np.abs(patch.vertices[:, 1]) < 8  # the foot lies on the sheet
    true = guide / np.hypot(1.0, 0.3)
    assert np.abs(distance - true)[inside].max() < 1e-3
    assert np.median(np.abs(distance - true)[inside]) < 1e-9


def test_distance_on_a_flat_rectangle_is_that_of_the_nearest_side(make):
    patch = make.wavy(amplitude=0.0)
    distance, _, _ = from_rim(connect(patch))
    x, y = np.abs(patch.vertices[:, 0]), np.abs(patch.vertices[:, 1])
    true = np.minimum(20 - x, 15 - y)
    assert np.abs(distance - true).max() < 0.15  # only along the diagonals
    assert np.quantile(np.abs(distance - true), 0.98) < 1e-6


def test_a_closed_shell_is_measured_from_its_lowest_point():
    import trimesh

    from vega_planner.datatypes import Patch

    ball = trimesh.creation.icosphere(subdivisions=5, radius=10.0)
    up = np.tile([0.0, 0.0, 1.0], (len(ball.vertices), 1))
    surface = connect(Patch(0, ball.vertices, ball.faces, np.ones(len(ball.vertices)), up))
    distance, _, _ = from_rim(surface)
    start = surface.vertices[np.argmin(distance)]
    assert start[2] == surface.vertices[:, 2].min()
    angle = np.arccos(np.clip(surface.vertices @ start / 100, -1, 1))
    assert np.abs(distance - 10 * angle).max() < 0.05


def test_values_of_the_rim_travel_along_the_shortest_ways(make):
    patch = make.dome(20.0, 60.0, 8000)
    azimuth = np.arctan2(patch.vertices[:, 1], patch.vertices[:, 0])
    _, _, brought = from_rim(connect(patch), np.column_stack([np.cos(azimuth)]))
    away = np.hypot(patch.vertices[:, 0], patch.vertices[:, 1]) > 2
    assert np.abs(brought[:, 0] - np.cos(azimuth))[away].max() < 0.1


@pytest.mark.parametrize("seed", [1, 2])
def test_relabelling_the_vertices_changes_no_distance(make, seed):
    patch = make.wavy(triangles=3000)
    order = np.random.default_rng(seed).permutation(len(patch.vertices))
    back = np.argsort(order)
    from vega_planner.datatypes import Patch

    other = Patch(
        0, patch.vertices[order], back[patch.faces], patch.thickness, patch.tool_axes[order]
    )
    a, _, _ = from_rim(connect(patch))
    b, _, _ = from_rim(connect(other))
    assert np.abs(a[order] - b).max() < 1e-3
