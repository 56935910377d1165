# SPDX-License-Identifier: Apache-2.0
"""What goes into a message comes out of it."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from visualization_msgs.msg import MarkerArray

from vega_msgs.action import ExecutePrint, PlanLayers
from vega_msgs.msg import JointPath, Layers, Setting, Toolpaths
from vega_planner.datatypes import Layer, PrintTrajectory, Toolpath
from vega_planner.errors import CertificateMismatch, InvalidInput
from vega_planner.nodes.cdr import LINE_STRIP, TRIANGLE_LIST, ShapeMarker, marker_array
from vega_planner.nodes.conversions import (
    joint_trajectory_to_msg,
    layers_from_msg,
    layers_to_msg,
    mesh_from_msg,
    mesh_to_msg,
    pose_from_msg,
    pose_to_msg,
    request_from_msg,
    toolpaths_from_msg,
    toolpaths_to_msg,
    trajectory_from_msg,
    trajectory_to_msg,
)
from vega_planner.nodes.markers import MOST_LINE_POINTS, line_pieces
from vega_planner.settings import Settings
from vega_robot_driver.nodes.conversions import job_from_msg, job_of_trajectory
from vega_robot_driver.nodes.follow_joint_trajectory import check_start, ordered_job

RANDOM = np.random.default_rng(7)


def through(message, kind):
    """Send a message over the wire, as bytes."""
    return deserialize_message(serialize_message(message), kind)


def sheets() -> tuple[Layer, ...]:
    made = []
    for index, (points, faces) in enumerate(((4, 2), (5, 3), (3, 1))):
        made.append(
            Layer(
                index,
                "core" if index == 2 else "envelope",
                0.4 + 0.8 * index,
                RANDOM.normal(size=(points, 3)) * 20,
                RANDOM.integers(0, points, (faces, 3)),
                RANDOM.uniform(0.5, 0.9, points),
            )
        )
    return tuple(made)


def test_layers():
    for old, new in zip(sheets(), layers_from_msg(through(layers_to_msg(sheets()), Layers))):
        assert new.kind == old.kind and new.index == old.index
        assert new.depth_mm == pytest.approx(old.depth_mm, rel=1e-12)
    one = sheets()
    two = layers_from_msg(through(layers_to_msg(one), Layers))
    for old, new in zip(one, two, strict=True):
        assert (new.faces == old.faces).all()
        assert np.allclose(new.vertices, old.vertices, rtol=1e-14)
        assert np.allclose(new.thickness, old.thickness, rtol=1e-14)


def test_toolpaths():
    passes = tuple(
        Toolpath(
            RANDOM.normal(size=(n, 3)),
            np.tile([0.0, 0.0, 1.0], (n, 1)),
            np.full(n, 1.2),
            np.full(n, 0.8),
            patch=n,
            layer=n - 2,
            closed=n == 3,
        )
        for n in (2, 3, 7)
    )
    back = toolpaths_from_msg(through(toolpaths_to_msg(passes), Toolpaths))
    for old, new in zip(passes, back, strict=True):
        assert (new.patch, new.layer, new.closed) == (old.patch, old.layer, old.closed)
        assert np.allclose(new.points, old.points, rtol=1e-14)
        assert np.allclose(new.width, old.width) and np.allclose(new.height, old.height)


def trajectory(count: int = 50) -> PrintTrajectory:
    T = np.eye(4)
    T[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    T[:3, 3] = 0.1, 0.2, 0.3
    return PrintTrajectory(
        joint_names=("x", "y", "z", "a", "b"),
        times=np.cumsum(RANDOM.uniform(0.01, 0.1, count)),
        positions=RANDOM.normal(size=(count, 5)),
        velocities=RANDOM.normal(size=(count, 5)),
        extrude=RANDOM.random(count) > 0.5,
        path_id=RANDOM.integers(-1, 3, count),
        T_base_part=T,
    )


def test_trajectory():
    old = trajectory()
    new = trajectory_from_msg(through(trajectory_to_msg(old, [0, 0, 1]), JointPath))
    for name in ("times", "positions", "velocities", "extrude", "path_id"):
        assert (getattr(new, name) == getattr(old, name)).all()
    assert np.allclose(new.T_base_part, old.T_base_part, atol=1e-15)


def test_joint_trajectory_is_read_by_the_driver():
    old = trajectory()
    job = job_of_trajectory(joint_trajectory_to_msg(old))
    assert np.allclose(job.times, old.times - old.times[0], atol=2e-9)
    assert (job.positions == old.positions).all()
    assert not job.extrude.any()


def test_pose_and_mesh():
    T = trajectory().T_base_part
    assert np.allclose(pose_from_msg(pose_to_msg(T)), T, atol=1e-15)
    points, faces = RANDOM.normal(size=(5, 3)), RANDOM.integers(0, 5, (4, 3))
    new_points, new_faces = mesh_from_msg(mesh_to_msg(points, faces))
    assert np.allclose(new_points, points, rtol=1e-14) and (new_faces == faces).all()


def test_a_goal_replaces_the_nodes_settings_in_order():
    goal = PlanLayers.Goal(
        mesh="file:///tmp/a%20b.stl",
        settings="layers: {thickness_mm: 0.6}\ntoolpaths: {width_mm: 1.0}",
        options=[Setting(key="layers.thickness_mm", value="0.5"), Setting(key="seed", value="3")],
        brr=["down"],
    )
    request = request_from_msg(goal, Settings().updated({"toolpaths": {"pattern": "zigzag"}}))
    assert request.mesh == "/tmp/a b.stl"
    assert request.settings.layers.thickness_mm == 0.5
    assert request.settings.toolpaths.width_mm == 1.0
    assert request.settings.toolpaths.pattern == "zigzag"
    assert request.settings.seed == 3
    assert request.settings.part.brr == ("down",)


@pytest.mark.parametrize(
    ("goal", "text"),
    [
        (PlanLayers.Goal(mesh="http://x/y.stl"), "choices: a path or a file"),
        (PlanLayers.Goal(mesh="a", settings="{"), "no YAML"),
        (PlanLayers.Goal(mesh="a", settings="layers: {thicknes: 1}"), "unknown setting"),
        (PlanLayers.Goal(mesh="a", options=[Setting(key="x.y", value="1")]), "unknown setting"),
    ],
)
def test_a_wrong_goal_is_told_in_one_line(goal, text):
    with pytest.raises(InvalidInput, match=text) as caught:
        request_from_msg(goal, Settings())
    assert "\n" not in str(caught.value)


def test_markers_in_raw_cdr_are_what_the_message_type_reads():
    shapes = [
        ShapeMarker(
            "layer_000", 3, TRIANGLE_LIST, RANDOM.normal(size=(6, 3)), (1, 0.5, 0, 1), "part"
        ),
        ShapeMarker(
            "a", 1, LINE_STRIP, RANDOM.normal(size=(5, 3)), (0, 0, 1, 0.5), "base", 0.0012
        ),
        ShapeMarker("empty", 2, LINE_STRIP, np.zeros((0, 3)), (0, 0, 1, 0.5), "base"),
    ]
    data = marker_array(shapes)
    message = deserialize_message(data, MarkerArray)
    assert message.markers[0].action == 3 and len(message.markers) == 4
    for shape, marker in zip(shapes, message.markers[1:], strict=True):
        assert (marker.ns, marker.id, marker.type) == (shape.namespace, shape.number, shape.kind)
        assert marker.header.frame_id == shape.frame
        assert marker.pose.orientation.w == 1.0 and marker.frame_locked
        assert np.array_equal([(p.x, p.y, p.z) for p in marker.points], shape.points.tolist())
    assert message.markers[2].scale.x == 0.0012
    # the serialiser leaves what was in memory between values, so bytes are not compared
    assert len(serialize_message(message)) == len(data)
    assert deserialize_message(serialize_message(message), MarkerArray) == message


def test_lines_are_cut_with_shared_ends():
    points = RANDOM.normal(size=(25_001, 3))
    pieces = [points[piece] for piece in line_pieces(len(points))]
    assert max(map(len, pieces)) <= MOST_LINE_POINTS
    assert np.array_equal(np.concatenate([pieces[0], *(p[1:] for p in pieces[1:])]), points)
    assert all((a[-1] == b[0]).all() for a, b in itertools.pairwise(pieces))


def test_a_job_without_its_certificate_is_refused():
    path = trajectory_to_msg(trajectory(), [])
    path.times = [t - path.times[0] for t in path.times]
    goal = ExecutePrint.Goal(trajectory=path)
    with pytest.raises(CertificateMismatch, match="no certificate"):
        job_from_msg(goal)
    goal.certificate = '{"sha256": {"job": "00"}}'
    with pytest.raises(CertificateMismatch, match="for job 00"):
        job_from_msg(goal)
    goal.certificate = "{"
    with pytest.raises(CertificateMismatch, match="cannot be read"):
        job_from_msg(goal)


def test_a_trajectory_may_name_its_joints_in_another_order():
    msg = joint_trajectory_to_msg(trajectory())
    old = job_of_trajectory(msg)
    msg.joint_names = msg.joint_names[::-1]
    for point in msg.points:
        point.positions = point.positions[::-1]
        point.velocities = point.velocities[::-1]
    new = ordered_job(msg, old.joint_names)
    assert (new.positions == old.positions).all()
    assert (new.velocities == old.velocities).all()
    with pytest.raises(InvalidInput, match="the robot has a, b"):
        ordered_job(msg, ("a", "b"))


def test_a_trajectory_that_begins_elsewhere_is_refused():
    job = job_of_trajectory(joint_trajectory_to_msg(trajectory()))
    check_start(job, job.positions[0] + 1e-3)
    with pytest.raises(InvalidInput, match=f"begins with {job.joint_names[1]} at"):
        check_start(job, job.positions[0] + np.eye(len(job.joint_names))[1] * 0.01)
