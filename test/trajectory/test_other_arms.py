# SPDX-License-Identifier: Apache-2.0
"""Wrists with a singularity in the work, limited turns, and arms of six joints."""

from __future__ import annotations

import numpy as np
import pytest

from vega_planner.errors import Unreachable
from vega_planner.settings import TrajectorySettings
from vega_planner.trajectory import make_trajectory
from vega_planner.trajectory.checks import (
    deviation,
    largest_printing_step,
    limit_excess,
    steady_ratio,
)

from .shapes import dome_lines, dome_spiral, line, pass_of, with_travels

SETTINGS = TrajectorySettings()


def over_the_apex(distance, radius=30.0, half=20.0):
    """A straight pass over a sphere that leaves the apex aside by a distance [mm]."""
    x = np.arange(-half, half + 0.01, 0.5)
    flat = np.column_stack([x, np.full_like(x, distance)])
    z = np.sqrt(radius**2 - (flat**2).sum(1))
    return pass_of(np.column_stack([flat, z - 14]), np.column_stack([flat, z]))


@pytest.mark.parametrize("distance", [0.0, 0.01, 0.1, 0.2, 0.3, 0.6, 1.0, 3.0])
def test_the_singular_direction_is_crossed_with_the_tip_exact(gantry, distance):
    """Vertical first axis: the nozzle is along it over the apex."""
    cell = gantry()
    toolpaths = with_travels([over_the_apex(distance)])
    trajectory = make_trajectory(toolpaths, cell, SETTINGS)
    off = deviation(trajectory, toolpaths, cell)
    assert off.tip_mm <= 0.010
    assert off.axis_rad <= np.radians(0.6)
    assert limit_excess(trajectory, cell.robot) <= 0.0
    assert largest_printing_step(trajectory, cell.robot) <= 0.2
    # without help the first axis would have to turn 3 million degrees per second at 1 µm
    assert trajectory.slow_ratio < 0.08


def test_far_from_the_singularity_the_axis_is_exact(gantry):
    cell = gantry()
    toolpaths = with_travels([over_the_apex(3.0)])
    off = deviation(make_trajectory(toolpaths, cell, SETTINGS), toolpaths, cell)
    assert off.axis_rad <= np.radians(0.1)


def test_the_apex_is_harmless_where_no_axis_is_vertical(vega5):
    toolpaths = with_travels([over_the_apex(0.1)])
    trajectory = make_trajectory(toolpaths, vega5, SETTINGS)
    off = deviation(trajectory, toolpaths, vega5)
    assert off.axis_rad <= np.radians(0.1)
    assert steady_ratio(trajectory, vega5.robot, 0.005) > 0.999


@pytest.mark.parametrize("limits", [(-6.3, 6.3), (-3.3, 3.3)])
def test_a_dome_of_parallel_lines_is_printed_in_one_pass(gantry, limits):
    cell = gantry(first_limits=limits)
    toolpaths = with_travels([dome_lines()])
    trajectory = make_trajectory(toolpaths, cell, SETTINGS)
    off = deviation(trajectory, toolpaths, cell)
    assert off.tip_mm <= 0.010
    assert off.axis_rad <= np.radians(0.6)
    assert limit_excess(trajectory, cell.robot) <= 0.0
    assert largest_printing_step(trajectory, cell.robot) <= 0.2


def test_an_endless_axis_winds_up_along_a_spiral(gantry):
    cell = gantry(first_kind="continuous")
    toolpaths = with_travels([dome_spiral(rim_deg=40.0)])
    trajectory = make_trajectory(toolpaths, cell, SETTINGS)
    turned = np.ptp(trajectory.positions[:, 3])
    assert turned > 2 * np.pi * 15
    assert deviation(trajectory, toolpaths, cell).tip_mm <= 0.010
    assert largest_printing_step(trajectory, cell.robot) <= 0.2


def test_a_limited_axis_that_would_wind_up_is_told(gantry):
    cell = gantry(first_limits=(-3.3, 3.3))
    with pytest.raises(Unreachable, match="'j1' would jump"):
        make_trajectory(with_travels([dome_spiral()]), cell, SETTINGS)


def test_between_passes_a_limited_axis_unwinds(gantry):
    """Two passes of three quarters of a turn each, in one sense: the second needs room."""
    cell = gantry(first_limits=(-3.3, 3.3))
    turn = np.linspace(-3.0, 3.0, 200)
    ring = np.column_stack([np.cos(turn), np.sin(turn)])
    passes = []
    for rotation in (0.0, np.pi):
        c, s = np.cos(rotation), np.sin(rotation)
        xy = ring @ np.array([[c, s], [-s, c]])
        points = np.column_stack([20 * xy, np.full(200, 10.0)])
        passes.append(pass_of(points, np.column_stack([xy, np.full(200, 1.0)])))
    toolpaths = with_travels(passes)
    trajectory = make_trajectory(toolpaths, cell, SETTINGS)
    assert deviation(trajectory, toolpaths, cell).tip_mm <= 0.010
    assert limit_excess(trajectory, cell.robot) <= 0.0
    assert any("changes its configuration" in text for text in trajectory.warnings)


@pytest.mark.parametrize("name", ["spiral", "lines"])
def test_an_arm_of_six_joints_prints_a_dome(ur5e, name):
    path = dome_spiral() if name == "spiral" else dome_lines(spacing=3.0)
    toolpaths = with_travels([path])
    trajectory = make_trajectory(toolpaths, ur5e, SETTINGS)
    for curve in ("cubic", "linear"):
        off = deviation(trajectory, toolpaths, ur5e, curve)
        assert off.tip_mm <= 0.010
        assert off.axis_rad <= np.radians(0.4)
    assert limit_excess(trajectory, ur5e.robot) <= 0.0
    assert largest_printing_step(trajectory, ur5e.robot) <= 0.2


def test_the_free_turn_keeps_an_arm_off_its_limits(ur5e):
    toolpaths = with_travels([dome_spiral()])
    trajectory = make_trajectory(toolpaths, ur5e, SETTINGS)
    room = np.minimum(
        trajectory.positions - ur5e.robot.lower, ur5e.robot.upper - trajectory.positions
    )
    assert room.min() > 0.2


def test_a_spiral_does_not_wind_a_six_axis_arm_up(ur5e):
    trajectory = make_trajectory(with_travels([dome_spiral()]), ur5e, SETTINGS)
    assert np.ptp(trajectory.positions, axis=0).max() < 2 * np.pi


def test_a_five_joint_machine_without_closed_form_is_solved_numerically(gantry):
    cell = gantry(first="1 0 0", first_limits=(-2.0, 2.0))
    toolpaths = with_travels([line([[-15, 0, 1], [15, 5, 1]]), dome_spiral(rim_deg=30.0)])
    exact = make_trajectory(toolpaths, cell, SETTINGS)
    object.__setattr__(cell.robot, "closed_form", None)
    numeric = make_trajectory(toolpaths, cell, SETTINGS)
    assert deviation(numeric, toolpaths, cell).tip_mm <= 0.010
    assert limit_excess(numeric, cell.robot) <= 0.0
    assert numeric.duration_s == pytest.approx(exact.duration_s, rel=1e-2)
