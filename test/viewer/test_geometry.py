# SPDX-License-Identifier: Apache-2.0
"""Level of detail, glTF, robot model, timeline."""

import io
import json
import struct
from itertools import pairwise

import numpy as np
import pytest
import trimesh

from vega_planner.errors import BadRobot
from vega_planner.viewer.colours import speed_colours
from vega_planner.viewer.glb import lines_glb, shaded_glb, triangles_glb
from vega_planner.viewer.legend import legend
from vega_planner.viewer.level_of_detail import clustered, kept_rows
from vega_planner.viewer.path_view import cut_into_pieces
from vega_planner.viewer.result_folder import faces_in_common, read_result
from vega_planner.viewer.robot_model import quaternion_wxyz, read_robot_model
from vega_planner.viewer.section import Cut, clipped
from vega_planner.viewer.timeline import row_times
from vega_planner.viewer.tip_speed import tip_speeds

BALL = trimesh.creation.icosphere(4, 10.0)


def test_a_coarser_ball_keeps_its_size_within_the_budget():
    vertices, faces = clustered(BALL.vertices, BALL.faces, 600)
    assert 150 < len(faces) <= 600
    coarse = trimesh.Trimesh(vertices, faces, process=False)
    assert coarse.area == pytest.approx(BALL.area, rel=0.1)
    np.testing.assert_allclose(np.linalg.norm(vertices, axis=1), 10.0, atol=0.7)


def test_a_mesh_within_the_budget_is_left_alone():
    vertices, faces = clustered(BALL.vertices, BALL.faces, len(BALL.faces))
    assert vertices is BALL.vertices
    assert faces is BALL.faces


def test_thinning_keeps_ends_and_corners_and_the_budget():
    """A square wave: its corners say everything about it."""
    x = np.repeat(np.arange(50), 2)[1:-1].astype(float)
    y = np.resize([0.0, 1.0, 1.0, 0.0], len(x))
    corners = np.column_stack([x, y, 0 * x])
    fine = np.concatenate(
        [np.linspace(a, b, 40, endpoint=False) for a, b in pairwise(corners)] + [corners[-1:]]
    )
    ends = np.zeros(len(fine), bool)
    ends[[0, -1]] = True
    rows = kept_rows(fine, ends, 1000)
    assert len(rows) <= 1001
    kept = {tuple(point) for point in fine[rows]}
    assert {tuple(point) for point in corners} <= kept


def test_an_independent_reader_finds_the_triangles_of_a_glb():
    colours = np.full((len(BALL.vertices), 3), 200, np.uint8)
    data = triangles_glb(BALL.vertices, BALL.faces, colours)
    scene = trimesh.load(io.BytesIO(data), file_type="glb", process=False)
    mesh = next(iter(scene.geometry.values()))
    np.testing.assert_allclose(mesh.vertices, BALL.vertices, atol=1e-5)
    np.testing.assert_array_equal(mesh.faces, BALL.faces)


def test_a_glb_of_lines_says_so_and_has_the_lengths_it_declares():
    data = lines_glb(np.eye(3), np.array([[0, 1], [1, 2]]), np.zeros((3, 3)))
    magic, version, total = struct.unpack_from("<4sII", data)
    assert (magic, version, total) == (b"glTF", 2, len(data))
    length = struct.unpack_from("<I", data, 12)[0]
    header = json.loads(data[20 : 20 + length])
    assert header["meshes"][0]["primitives"][0]["mode"] == 1
    assert header["accessors"][2]["count"] == 4
    body = struct.unpack_from("<I", data, 20 + length)[0]
    assert body >= header["buffers"][0]["byteLength"]


def test_shaded_faces_are_lighter_on_top_than_below():
    data = shaded_glb(BALL.vertices, BALL.faces, (200, 200, 200))
    count = 3 * len(BALL.faces)
    start = 20 + struct.unpack_from("<I", data, 12)[0] + 8
    height = np.frombuffer(data, "<f4", 3 * count, start).reshape(-1, 3)[:, 2]
    light = np.frombuffer(data, "<u2", 4 * count, start + 12 * count).reshape(-1, 4)[:, 0] * 1.0
    assert light[height > 8].mean() > light[height < -8].mean() + 5000


def test_the_model_moves_as_the_robots_own_kinematics_do():
    """Independent answer: pinocchio's forward kinematics of the same URDF."""
    from vega_planner.robot.robot import load_robot

    robot = load_robot("vega5")
    model = read_robot_model(robot.urdf)
    rng = np.random.default_rng(3)
    for _ in range(5):
        q = rng.uniform(np.maximum(robot.lower, -3), np.minimum(robot.upper, 3))
        pose = model.link_poses(dict(zip(robot.joint_names, q)))["tip"]
        tip, axis = robot.forward(q[None])
        np.testing.assert_allclose(pose[:3, 3], tip[0], atol=1e-9)
        np.testing.assert_allclose(pose[:3, 2], axis[0], atol=1e-9)


def test_links_keep_the_volume_of_their_shapes():
    urdf = """<robot name="r"><link name="a">
      <visual><geometry><box size="1 2 3"/></geometry></visual>
      <visual><origin xyz="0 0 9" rpy="1 2 3"/><geometry><box size="1 1 1"/></geometry></visual>
    </link></robot>"""
    visual = read_robot_model(urdf).visuals["a"][0]
    mesh = trimesh.Trimesh(visual.vertices, visual.faces, process=True)
    assert mesh.volume == pytest.approx(7.0)


@pytest.mark.parametrize(
    "text", ["<robot", "<robot><link name='a'/><link name='b'/></robot>",
             "<robot><link name='a'><visual><geometry><cone/></geometry></visual></link></robot>"],
)  # fmt: skip
def test_a_urdf_that_cannot_be_drawn_is_refused(text):
    with pytest.raises(BadRobot):
        read_robot_model(text)


def test_quaternions_are_those_of_scipy():
    from scipy.spatial.transform import Rotation

    for rotation in Rotation.random(20, rng=5):
        w, x, y, z = quaternion_wxyz(rotation.as_matrix())
        assert w >= 0
        again = Rotation.from_quat([x, y, z, w]).as_matrix()
        np.testing.assert_allclose(again, rotation.as_matrix(), atol=1e-12)


def test_rows_are_timed_by_their_pass_and_by_length_between():
    """Pass 0 runs from 1 s to 3 s at constant speed, then travel to pass 1 at 4 s."""
    points = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 0, 5], [9, 0, 0], [10.0, 0, 0]])
    path = np.array([0, 0, 0, -1, 1, 1])
    sample_times = np.array([0.0, 1.0, 2.0, 3.0, 3.5, 4.0, 6.0])
    sample_path = np.array([-1, 0, 0, 0, -1, 1, 1])
    times = row_times(points, path, sample_times, sample_path, 0.0)
    np.testing.assert_allclose(times[[0, 1, 2, 4, 5]], [1, 2, 3, 4, 6], atol=1e-4)
    assert 3.0 < times[3] < 4.0


def test_the_result_folder_reads_back_what_was_written(sample):
    result = read_result(sample)
    assert len(result.sheets) == 5
    base = result.part.vertices[result.part.faces][:, :, 2].max(1) < 1e-9
    assert (result.part.restrained == base).all()
    assert (result.face_reasons[0] == 2).any()
    assert not any(reason.any() for reason in result.face_reasons[1:])
    timeline = result.timeline
    assert timeline.duration_s == pytest.approx(result.summary["print_time_s"], abs=1e-6)
    assert (np.diff(timeline.times) >= 0).all()


def test_the_tip_over_time_is_where_the_joints_bring_it(sample):
    """The toolpath's clock and the trajectory's agree: two ways to the same point."""
    from vega_planner.robot.robot import load_robot

    result = read_result(sample)
    robot = load_robot("vega5")
    T = np.linalg.inv(result.T_base_part)
    for share in (0.11, 0.37, 0.62, 0.93):
        moment = result.timeline.at(share * result.timeline.duration_s)
        q = np.array([[moment.joints[name] for name in robot.joint_names]])
        tip = robot.forward(q)[0][0]
        in_part = 1000 * (T[:3, :3] @ tip + T[:3, 3])
        np.testing.assert_allclose(in_part, moment.tip, atol=0.5)


def test_the_pieces_of_a_toolpath_cover_every_pass_from_end_to_end(sample):
    timeline = read_result(sample).timeline
    pieces = cut_into_pieces(timeline, 700)
    starts = np.concatenate([piece.starts for piece in pieces])
    ends = np.concatenate([piece.ends for piece in pieces])
    assert len(starts) <= 720
    for path in range(5):
        rows = np.flatnonzero(timeline.path_id == path)
        mine = timeline.path_id[ends] == path
        assert starts[mine][0] == rows[0]
        assert ends[mine][-1] == rows[-1]
        np.testing.assert_array_equal(starts[mine][1:], ends[mine][:-1])


def test_faces_in_common_are_those_that_were_cut_out():
    chosen = np.zeros(len(BALL.faces), bool)
    chosen[::7] = True
    used, flat = np.unique(BALL.faces[chosen], return_inverse=True)
    found = faces_in_common(BALL.vertices, BALL.faces, BALL.vertices[used], flat.reshape(-1, 3))
    assert (found == chosen).all()


def test_the_speed_of_the_tip_is_told_along_each_pass():
    """A pass at 5 mm/s that halves its speed after 6 of its 10 mm; travel has none."""
    way = np.concatenate([np.linspace(0, 6, 61), np.linspace(6, 10, 81)[1:]])
    tips = np.column_stack([way, np.zeros((len(way), 2))])
    tips = np.concatenate([tips, [[10, 20, 0]], tips + np.array([0, 20, 0])])
    times = np.concatenate([np.arange(len(way)) * 0.02, [3.0], 4 + np.arange(len(way)) * 0.04])
    sample_path = np.concatenate([np.zeros(len(way)), [-1], np.ones(len(way))]).astype(int)
    row = np.column_stack([np.linspace(0, 10, 21), np.zeros((21, 2))])
    points = np.concatenate([row, [[10, 20, 0]], row + np.array([0, 20, 0])])
    path_id = np.repeat([0, -1, 1, 2], [21, 1, 19, 2])
    speeds = tip_speeds(points, path_id, tips, times, sample_path)
    assert speeds[:12] == pytest.approx(5.0)
    assert speeds[14:21] == pytest.approx(2.5)
    assert speeds[21] == 0.0
    assert speeds[22] == pytest.approx(2.5)
    assert (speeds[-2:] == 0.0).all()


def test_slow_points_are_redder_than_fast_ones():
    shades = speed_colours(np.array([0.0, 5.0, 5.0, 99.0]), np.array([True, True, True, False]))
    assert shades[0, 0] > shades[1, 0]
    assert shades[0, 2] < shades[1, 2]
    assert (shades[1] == shades[2]).all()


@pytest.mark.parametrize("keep_low", [True, False])
def test_a_cut_is_exact(keep_low):
    """Half of a ball off its middle: area of the zone, and nothing beyond the plane."""
    cut = Cut(axis=0, at_mm=2.5, keep_low=keep_low)
    vertices, faces = clipped(BALL.vertices, BALL.faces, cut)
    used = vertices[np.unique(faces)]
    assert cut.beyond(used).max() <= 1e-12
    left = trimesh.Trimesh(vertices, faces, process=False)
    # Archimedes: the zone's area is proportional to its height.
    share = (10 + 2.5) / 20 if keep_low else (10 - 2.5) / 20
    assert left.area == pytest.approx(share * BALL.area, rel=1e-3)
    outward = np.einsum("ij,ij->i", left.face_normals, left.triangles_center)
    assert (outward[left.area_faces > 1e-9] > 0).all()


def test_an_open_border_stays_where_it_is_when_a_mesh_is_coarsened():
    half = BALL.slice_plane([0, 0, 0], [0, 0, 1])
    half.merge_vertices()
    vertices, faces = clustered(np.asarray(half.vertices), np.asarray(half.faces), 300)
    coarse = trimesh.Trimesh(vertices, faces, process=False)
    lowest = vertices[vertices[:, 2] < 0.2]
    assert len(lowest) > 20
    assert np.abs(lowest[:, 2]).max() < 1e-9
    assert np.linalg.norm(lowest[:, :2], axis=1).min() > 9.5
    assert coarse.area == pytest.approx(half.area, rel=0.1)


def test_the_legend_names_the_reasons_that_are_there():
    shown = legend((np.array([0, 2, 2]), np.array([3, 0])), by_speed=False)
    assert "wrist limit: the wrist cannot turn that far" in shown
    assert "own layer" in shown
    assert "out of travel" not in shown
    assert "full speed" not in shown
    assert "full speed" in legend((), by_speed=True)
