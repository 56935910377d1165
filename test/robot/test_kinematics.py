# SPDX-License-Identifier: Apache-2.0
"""Forward and inverse kinematics against pinocchio and against themselves."""

from __future__ import annotations

import numpy as np
import pinocchio
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vega_planner.robot.robot import OUT_OF_TRAVEL, REACHED, WRIST_LIMIT

#: Wrists on three linear axes: usual, square heads, nutating, skew, unusual linear axes.
WRISTS = {
    "c_and_b": {},
    "a_and_b": {"first": "1 0 0", "first_limits": (-2.0, 2.0)},
    "nutating": {"second": "0.70710678 0 0.70710678", "second_limits": (-3.2, 3.2)},
    "skew": {"first": "0.6 0 0.8", "second": "0 0.8 0.6", "between": "0.03 0.02 -0.05"},
    "leaning_slides": {"slides": ("1 0 0", "0.6 0.8 0", "0.3 0.2 0.9")},
    "endless": {"first_kind": "continuous"},
}


@pytest.fixture(params=WRISTS, scope="module")
def wrist(request, gantry):
    return gantry(**WRISTS[request.param]).robot


@pytest.fixture(params=["vega5", "ur5e"], scope="module")
def robot(request):
    return request.getfixturevalue(request.param).robot


def random_joints(robot, count, seed=1):
    lower = np.maximum(robot.lower, -np.pi)
    upper = np.minimum(robot.upper, np.pi)
    return lower + (upper - lower) * np.random.default_rng(seed).random((count, len(lower)))


def by_pinocchio(robot, q):
    """Tip positions and z axes of the tip frame, one configuration at a time."""
    model = pinocchio.buildModelFromXML(robot.urdf)
    data = model.createData()
    frame = model.getFrameId("tip")
    points, axes = [], []
    for row in q:
        full = pinocchio.neutral(model)
        for name, value in zip(robot.joint_names, row):
            joint = model.joints[model.getJointId(name)]
            if joint.nq == 2:
                full[joint.idx_q : joint.idx_q + 2] = np.cos(value), np.sin(value)
            else:
                full[joint.idx_q] = value
        pinocchio.framesForwardKinematics(model, data, full)
        points.append(data.oMf[frame].translation.copy())
        axes.append(data.oMf[frame].rotation[:, 2].copy())
    return np.array(points), np.array(axes)


def test_forward_kinematics_is_pinocchios(robot):
    q = random_joints(robot, 300)
    for own, reference in zip(robot.forward(q), by_pinocchio(robot, q)):
        np.testing.assert_allclose(own, reference, atol=1e-12)


def test_forward_kinematics_of_any_wrist_is_pinocchios(wrist):
    q = random_joints(wrist, 100)
    for own, reference in zip(wrist.forward(q), by_pinocchio(wrist, q)):
        np.testing.assert_allclose(own, reference, atol=1e-12)


def test_any_two_axis_wrist_on_linear_axes_has_a_closed_form(wrist):
    assert wrist.closed_form is not None


def test_an_arm_of_six_joints_has_none(ur5e):
    assert ur5e.robot.closed_form is None


def test_every_closed_form_solution_meets_its_target_by_pinocchio(wrist):
    points, axes = wrist.forward(random_joints(wrist, 200, seed=2))
    solutions = wrist.solve(points, axes)
    for branch in range(2):
        good = solutions.valid[:, branch]
        tip, nozzle = by_pinocchio(wrist, solutions.candidates[good, branch])
        np.testing.assert_allclose(tip, points[good], atol=2e-9)
        np.testing.assert_allclose(nozzle, axes[good], atol=2e-8)


def test_every_numeric_solution_meets_its_target_by_pinocchio(ur5e):
    robot = ur5e.robot
    points, axes = robot.forward(random_joints(robot, 300, seed=3))
    solutions = robot.solve(points, axes)
    good = solutions.valid[:, 0]
    tip, nozzle = by_pinocchio(robot, solutions.candidates[good, 0])
    np.testing.assert_allclose(tip, points[good], atol=1e-9)
    np.testing.assert_allclose(nozzle, axes[good], atol=1e-8)


def test_solutions_keep_the_limits(robot):
    points, axes = robot.forward(random_joints(robot, 2000, seed=4))
    solutions = robot.solve(points, axes)
    q = solutions.candidates[solutions.valid]
    assert (q >= robot.lower).all()
    assert (q <= robot.upper).all()


def test_no_reachable_target_is_missed_in_closed_form(wrist):
    points, axes = wrist.forward(random_joints(wrist, 20_000, seed=5))
    assert wrist.reachable(points, axes).all()


def test_no_reachable_target_is_missed_on_vega5(vega5):
    points, axes = vega5.robot.forward(random_joints(vega5.robot, 20_000, seed=6))
    assert vega5.robot.reachable(points, axes).all()


def test_at_most_one_reachable_target_of_a_thousand_is_missed_on_six_axes(ur5e):
    points, axes = ur5e.robot.forward(random_joints(ur5e.robot, 20_000, seed=7))
    assert (~ur5e.robot.reachable(points, axes)).mean() <= 1e-3


def test_closed_form_and_numeric_solver_agree_on_reach(vega5):
    robot = vega5.robot
    rng = np.random.default_rng(8)
    points = rng.uniform([-0.35, -0.35, 0.0], [0.35, 0.35, 0.5], (3000, 3))
    axes = rng.normal(size=(3000, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    exact = robot.reachable(points, axes)
    assert 0.05 < exact.mean() < 0.95
    assert (robot.numeric.solve(points, axes)[1] == exact).mean() > 0.999


def test_both_branches_differ_and_meet_the_same_target(gantry):
    robot = gantry().robot
    q = random_joints(robot, 500, seed=9)
    q[:, :3] *= 0.2  # room for the linear axes of the other branch
    solutions = robot.solve(*robot.forward(q))
    both = solutions.valid.all(1)
    assert both.mean() > 0.9
    tilted = both & (np.abs(q[:, 4]) > 0.05)
    apart = np.abs(np.diff(solutions.candidates[tilted], axis=1)).max((1, 2))
    assert (apart > 0.05).all()


@settings(deadline=None, derandomize=True, max_examples=60)
@given(
    st.tuples(*[st.floats(-0.15, 0.15)] * 2),
    st.floats(-0.15, -0.01),
    st.tuples(*[st.floats(-1.4, 1.4)] * 2),
)
def test_a_pose_of_vega5_leads_back_to_its_joints(xy, z, wrist_angles):
    from vega_planner.robot import load_robot

    robot = load_robot("vega5")
    q = np.array([[*xy, z, *wrist_angles]])
    solutions = robot.solve(*robot.forward(q))
    away = np.abs(solutions.candidates[0] - q[0]).max(1)
    assert away[solutions.valid[0]].min() < 1e-7


def test_the_first_axis_is_held_where_the_nozzle_lies_along_it(gantry):
    robot = gantry().robot
    solutions = robot.solve(np.array([[0.0, 0.0, 0.1]]), np.array([[0.0, 0.0, 1.0]]))
    assert solutions.valid.all()
    np.testing.assert_allclose(solutions.candidates[0, :, 3:], 0.0, atol=1e-12)


def test_reasons_tell_travel_from_wrist(vega5):
    up, down = [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]
    points = np.array([[0.0, 0.0, 0.23], [0.6, 0.0, 0.23], [0.0, 0.0, 0.23]])
    reasons = vega5.robot.reach_reason(points, np.array([up, up, down]))
    assert reasons.tolist() == [REACHED, OUT_OF_TRAVEL, WRIST_LIMIT]


def test_reasons_of_an_arm_tell_travel_from_wrist(gantry):
    robot = gantry(first_limits=(-0.3, 0.3), second_limits=(-0.3, 0.3)).robot
    object.__setattr__(robot, "closed_form", None)
    points = np.array([[0.0, 0.0, 0.1], [0.6, 0.0, 0.1], [0.0, 0.0, 0.1]])
    axes = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    assert robot.reach_reason(points, axes).tolist() == [REACHED, OUT_OF_TRAVEL, WRIST_LIMIT]


def test_every_horizontal_direction_is_within_vega5s_wrist(vega5):
    turn = np.linspace(0, 2 * np.pi, 360)
    axes = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(360)])
    points = np.tile([0.0, 0.0, 0.26], (360, 1))
    assert vega5.robot.reachable(points, axes).all()


@pytest.mark.parametrize("name", ["vega5", "ur5e"])
def test_a_part_of_sixty_millimetres_is_reached_from_75_degrees_all_round(name, request):
    cell = request.getfixturevalue(name)
    rng = np.random.default_rng(10)
    points = rng.uniform([-30, -30, 0.4], [30, 30, 60], (4000, 3))
    tilt, turn = np.arccos(rng.uniform(np.cos(np.radians(75)), 1, 4000)), rng.uniform(0, 7, 4000)
    axes = np.column_stack(
        [np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)]
    )
    assert cell.reachable(points, axes).all()
