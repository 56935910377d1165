# SPDX-License-Identifier: Apache-2.0
"""The way to a job, or back to an interrupted bead: lifted, over everything that is printed."""

from __future__ import annotations

import numpy as np
import pytest

from vega_planner.robot.robot import load_robot
from vega_robot_driver.approach import SPEED_RATIO, joint_route
from vega_robot_driver.curve import Curve
from vega_robot_driver.resume import BACK_OFF, CROSSING_HEIGHT, approach

HERE = np.array([0.03, -0.02, -0.11, 0.3, 0.2])
GOAL = np.array([-0.04, 0.03, -0.12, -0.2, 0.4])


@pytest.fixture(scope="module")
def robot():
    return load_robot("vega5")


def tips(robot, rows):
    return robot.forward(np.atleast_2d(rows))


def test_it_backs_off_along_the_nozzle_and_crosses_above_everything(robot):
    top = float(max(tips(robot, HERE)[0][0, 2], tips(robot, GOAL)[0][0, 2])) + 0.004
    way = approach(robot, HERE, GOAL, top)
    assert way.shape == (4, 5)
    for near, step in ((HERE, way[0]), (GOAL, way[-1])):
        (tip, back), (axis, same) = (rows for rows in tips(robot, [near, step]))
        assert back - tip == pytest.approx(BACK_OFF * axis, abs=1e-6)
        assert same == pytest.approx(axis, abs=1e-6)
    # The whole way between the two heights, not only its ends.
    _, positions, _ = joint_route(way[1:3], robot.velocity)
    # The nozzle turns meanwhile, and swings the tip down: the ends are that much higher.
    heights = tips(robot, positions)[0][:, 2]
    assert heights.min() > top + CROSSING_HEIGHT - 2e-5
    assert heights.max() > top + CROSSING_HEIGHT + 1e-3
    # On the way up and down it stays where it is in the plane.
    for low, high in ((way[0], way[1]), (way[3], way[2])):
        found = tips(robot, np.linspace(low, high, 20))[0]
        assert np.ptp(found[:, :2], axis=0).max() < 1e-6
        assert (np.diff(found[:, 2]) > 0).all()


def test_no_turn_of_the_nozzle_swings_the_tip_into_what_is_printed(robot):
    chance = np.random.default_rng(4)
    low, high = np.array([-0.05, -0.05, -0.12, -1.2, -1.2]), np.array([0.05, 0.05, -0.1, 1.2, 1.2])
    crossed = 0
    for _ in range(40):
        here, goal = chance.uniform(low, high), chance.uniform(low, high)
        top = float(tips(robot, [here, goal])[0][:, 2].max())
        way = approach(robot, here, goal, top)
        if len(way) < 4:  # too high for this robot
            continue
        crossed += 1
        _, positions, _ = joint_route(way[1:3], robot.velocity)
        assert tips(robot, positions)[0][:, 2].min() > top + CROSSING_HEIGHT - 1e-4
    assert crossed > 20


def test_it_never_comes_down_to_cross(robot):
    """A tip that is above everything already does not sink to the crossing height."""
    way = approach(robot, HERE, GOAL, -1.0)
    heights = tips(robot, way)[0][:, 2]
    assert heights[1] >= heights[0] - 1e-9
    assert heights[2] >= heights[3] - 1e-9


def test_a_height_out_of_reach_is_left_out(robot):
    assert approach(robot, HERE, GOAL, 5.0).shape == (2, 5)


def test_there_is_no_way_to_where_it_is(robot):
    assert approach(robot, HERE, HERE, 0.0).shape == (0, 5)


def test_a_route_rests_at_every_configuration_and_keeps_its_speed(robot):
    points = np.array([HERE, GOAL, GOAL, HERE + 0.01])
    times, positions, velocities = joint_route(points, robot.velocity)
    assert (np.diff(times) > 0).all()
    for point in points:
        there = np.abs(positions - point).max(1) < 1e-12
        assert there.any() and not velocities[there].any()
    _, _, fastest, _ = Curve(times, positions, velocities).extremes(1e-3)
    assert (fastest <= SPEED_RATIO * robot.velocity * 1.001).all()
    assert (fastest / robot.velocity).max() > 0.9 * SPEED_RATIO
