# SPDX-License-Identifier: Apache-2.0
"""Links of the robot: an exact check of the URDF's own geometry finds nothing that is missed."""

from dataclasses import replace
from itertools import combinations, pairwise
from xml.etree import ElementTree

import coal
import numpy as np
import pinocchio
import pytest
import trimesh
from scipy.ndimage import minimum_filter
from scipy.spatial import cKDTree

from vega_planner.datatypes import PrintTrajectory, Toolpath, ToolpathSet, Travel
from vega_planner.printability.collisions import check_toolpaths
from vega_planner.printability.link_kernels import PRINT
from vega_planner.printability.link_repair import clear_motion
from vega_planner.printability.links import LinkWatch, least_about
from vega_planner.printability.robot_body import check_robot_body
from vega_planner.progress import silent
from vega_planner.robot.link_points import balls_on
from vega_planner.robot.urdf_geometry import origin_pose
from vega_planner.robot.workcell import load_cell
from vega_planner.settings import CellSettings, Settings
from vega_planner.trajectory import make_trajectory

from .envelopes import default_cell, dome

LINKS = ("x_carriage", "y_carriage", "z_slide", "a_bracket")

#: Rounded up: half the spacing of the balls, by which an edge may cross the plate's unseen.
UNSEEN_MM = 2.5


def resting(cell, q):
    """A print of one far pass, the robot standing still."""
    points = np.array([[500.0, 500.0, 0.4], [501.0, 500.0, 0.4]])
    up = np.tile([0.0, 0.0, 1.0], (2, 1))
    path = Toolpath(points, up, np.ones(2), np.ones(2), 0, 0)
    paths = ToolpathSet((path,), (Travel(points, up), Travel(points, up)))
    motion = PrintTrajectory(
        cell.robot.joint_names, np.array([0.0, 1.0]), np.tile(q, (2, 1)),
        np.zeros((2, len(q))), np.zeros(2, bool), np.array([-1, 0]),
        cell.placement.T_base_part,
    )  # fmt: skip
    return paths, motion


class Exact:
    """Gaps between links and other things, by pinocchio's model of the URDF and coal."""

    def __init__(self, robot):
        self.model = pinocchio.buildModelFromXML(robot.urdf)
        kind = pinocchio.GeometryType.COLLISION
        self.shapes = pinocchio.buildGeomFromUrdfString(self.model, robot.urdf, kind)
        self.data, self.at = self.model.createData(), self.shapes.createData()
        self.robot = robot

    def gaps(self, q, other=None, pose=None):
        """Gap [mm] of each link to a shape at a pose; to the plate when absent."""
        full = pinocchio.neutral(self.model)
        for name, value in zip(self.robot.joint_names, q):
            full[self.model.joints[self.model.getJointId(name)].idx_q] = value
        pinocchio.updateGeometryPlacements(self.model, self.data, self.shapes, self.at, full)
        links = [
            self.model.frames[shape.parentFrame].name for shape in self.shapes.geometryObjects
        ]
        if other is None:
            plate = links.index("build_plate")
            other = self.shapes.geometryObjects[plate].geometry
            pose = coal.Transform3s(self.at.oMg[plate].rotation, self.at.oMg[plate].translation)
        gaps = dict.fromkeys(LINKS, np.inf)
        for k, link in enumerate(links):
            if link in gaps:
                own = coal.Transform3s(self.at.oMg[k].rotation, self.at.oMg[k].translation)
                gap = coal.distance(
                    self.shapes.geometryObjects[k].geometry, own, other, pose,
                    coal.DistanceRequest(), coal.DistanceResult(),
                )  # fmt: skip
                gaps[link] = min(gaps[link], 1000 * gap)
        return gaps


def test_links_in_the_plate_are_found_and_no_others():
    cell = fat(default_cell())
    exact = Exact(cell.robot)
    rng = np.random.default_rng(3)
    lower, upper = cell.robot.lower, cell.robot.upper
    met = 0
    for _ in range(150):
        q = rng.uniform(lower, upper)
        q[2] = lower[2] + 0.3 * rng.uniform() * (upper[2] - lower[2])
        hits = {hit.link for hit in check_robot_body(*resting(cell, q), cell, silent).hits}
        for link, gap in exact.gaps(q).items():
            if gap < -UNSEEN_MM:
                assert link in hits
                met += 1
            if gap > 0.0:
                assert link not in hits
    assert met > 20


def test_links_in_what_is_printed_are_found_and_none_far_away():
    """Against print the balls that cover a link count, so that nothing is missed at all."""
    cell = default_cell()
    exact = Exact(cell.robot)
    rng = np.random.default_rng(4)
    lower, upper = cell.robot.lower, cell.robot.upper
    points = np.column_stack([np.linspace(-8, 8, 30), np.full(30, 3.0), np.full(30, 90.0)])
    up = np.tile([0.0, 0.0, 1.0], (30, 1))
    path = Toolpath(points, up, np.full(30, 1.2), np.full(30, 0.8), 0, 0)
    moves = (Travel(points, up),) * 3
    far = Toolpath(points + np.array([900, 0, 0]), up, np.full(30, 1.2), np.full(30, 0.8), 0, 0)
    watch = LinkWatch(ToolpathSet((path, far), moves), cell)
    assert watch.links.names == LINKS
    bead = coal.Capsule(0.0004, 0.016)
    pose = coal.Transform3s(
        np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]),
        cell.placement.T_base_part[:3, 3] + [0.0, 0.003, 0.09],
    )
    met = free = 0
    for _ in range(1500):
        q = rng.uniform(lower, upper) * [0.3, 0.3, 1.0, 1.0, 1.0]
        one = np.array(q)[None]
        found = watch.touching(one, np.array([1]))[0]
        before = watch.touching(one, np.array([0]))[0]
        assert not (before & PRINT).any()  # it is not there yet
        for link, gap in exact.gaps(q, bead, pose).items():
            seen = bool(found[LINKS.index(link)] & PRINT)
            if gap < 0.0:
                assert seen
                met += 1
            if gap > 9.0:
                assert not seen
                free += 1
        if (found & PRINT).any():
            link = int(np.argmax(found & PRINT))
            at = watch.place(q, 1, link, PRINT)
            assert np.linalg.norm(points - at, axis=1).min() < 9.0
    assert met > 20 and free > 1000


def fat(cell):
    """The cell with a thick disc about the wrist, which meets the plate where it leans."""
    disc = (
        '<collision><origin xyz="0 0 0" rpy="1.5708 0 0"/><geometry>'
        '<cylinder radius="0.03" length="0.07"/></geometry></collision>'
    )
    urdf = cell.robot.urdf.replace('<link name="a_bracket">', f'<link name="a_bracket">{disc}')
    assert urdf != cell.robot.urdf
    return replace(cell, robot=replace(cell.robot, urdf=urdf))


def ring(tilt_deg, turns=60):
    """Two rings round a small dome, the nozzle leaning outward."""
    turn = np.linspace(0, 2 * np.pi, turns)
    out = np.column_stack([np.cos(turn), np.sin(turn), 0 * turn])
    axes = np.sin(np.radians(tilt_deg)) * out + [0, 0, np.cos(np.radians(tilt_deg))]
    passes = [
        Toolpath(10.0 * out + [0, 0, z], axes, np.full(turns, 1.2), np.full(turns, 0.8), 0, 0)
        for z in (2.0, 2.8)
    ]
    high = [p.points + np.array([0, 0, 70]) for p in passes]
    moves = []
    for a, b in ((None, 0), (0, 1), (1, None)):
        ends = [passes[a].points[-1], high[a][-1]] if a is not None else []
        ends += [high[b][0], passes[b].points[0]] if b is not None else []
        along = np.concatenate([np.linspace(p, q, 40)[:-1] for p, q in pairwise(ends)])
        points = np.vstack([along, ends[-1]])
        moves.append(Travel(points, np.tile(axes[0], (len(points), 1))))
    return ToolpathSet(tuple(passes), tuple(moves))


def test_the_nozzle_leans_less_where_a_link_would_meet_the_plate():
    cell, stack, paths = fat(default_cell()), dome(), ring(74.0)
    settings = Settings()
    motion = make_trajectory(paths, cell, settings.trajectory)
    before = check_robot_body(paths, motion, cell, silent)
    assert {(hit.link, hit.obstacle) for hit in before.hits} == {("a_bracket", "plate")}
    check = check_toolpaths(paths, stack, cell, silent)
    turned, after, motion, body = clear_motion(paths, check, stack, cell, settings, silent)
    assert body.touching == 0 and body.hits == ()
    assert body.checked == len(motion.times)
    assert after.colliding == 0 and after.left_out_ratio == 0.0
    assert [p.points.tobytes() for p in turned.passes] == [
        p.points.tobytes() for p in paths.passes
    ]
    exact = Exact(cell.robot)
    for q in motion.positions[::40]:
        assert exact.gaps(q)["a_bracket"] > 0.0


def test_the_papers_policy_is_told_of_touching_links_and_left_alone():
    cell, stack, paths = fat(default_cell()), dome(), ring(74.0)
    settings = Settings().updated({"printability": {"orientation": "normal"}})
    check = check_toolpaths(paths, stack, cell, silent)
    same, _, _, body = clear_motion(paths, check, stack, cell, settings, silent)
    assert same is paths and body.touching > 0


def test_an_arm_with_a_free_turn_takes_a_configuration_that_touches_nothing():
    cell, stack, paths = load_cell(CellSettings(robot="ur5e")), dome(), ring(50.0)
    settings = Settings()
    blind = make_trajectory(paths, cell, settings.trajectory)
    assert check_robot_body(paths, blind, cell, silent).touching > 0
    check = check_toolpaths(paths, stack, cell, silent)
    same, _, motion, body = clear_motion(paths, check, stack, cell, settings, silent)
    assert same is paths and body.touching == 0
    assert motion.positions.shape[1] == 6


def test_vega5s_wrist_meets_neither_itself_nor_the_plate_where_it_prints():
    """All leans up to the default limit, the tip on the plate, and half turns of the lean."""
    cell = default_cell()
    exact = Exact(cell.robot)
    others = exact.shapes.geometryObjects
    link = [exact.model.frames[shape.parentFrame].name for shape in others]
    wrist = [k for k, name in enumerate(link) if name in ("z_slide", "a_bracket", "dispenser")]
    for tilt in (0.0, 40.0, 75.0):
        for turn in np.arange(0.0, 360.0, 30.0):
            lean, way = np.radians(tilt), np.radians(turn)
            axis = [np.sin(lean) * np.cos(way), np.sin(lean) * np.sin(way), np.cos(lean)]
            tip, axes = cell.to_base(np.array([[0.0, 0.0, 0.4]]), np.array([axis]))
            found = cell.robot.solve(tip, axes)
            q = found.candidates[0, int(np.argmax(found.valid[0]))]
            assert min(exact.gaps(q).values()) > 3.0
            for a, b in combinations(wrist, 2):
                if link[a] != link[b]:
                    at = [exact.at.oMg[k] for k in (a, b)]
                    poses = [coal.Transform3s(pose.rotation, pose.translation) for pose in at]
                    gap = coal.distance(
                        others[a].geometry, poses[0], others[b].geometry, poses[1],
                        coal.DistanceRequest(), coal.DistanceResult(),
                    )  # fmt: skip
                    assert gap > -1e-6


@pytest.mark.parametrize(
    "shape, inside, far",
    [
        ('<sphere radius="0.03"/>', lambda p: np.linalg.norm(p, axis=1) < 0.03, 0.03),
        (
            '<cylinder radius="0.03" length="0.08"/>',
            lambda p: (np.hypot(p[:, 0], p[:, 1]) < 0.03) & (abs(p[:, 2]) < 0.04),
            0.05,
        ),
        (
            '<box size="0.06 0.08 0.1"/>',
            lambda p: (abs(p) < [0.03, 0.04, 0.05]).all(1),
            np.sqrt(0.03**2 + 0.04**2 + 0.05**2),
        ),
        (
            '<box size="0.9 0.002 0.3"/>',
            lambda p: (abs(p) < [0.45, 0.001, 0.15]).all(1),
            np.sqrt(0.45**2 + 0.001**2 + 0.15**2),
        ),
    ],
)
def test_balls_cover_all_of_a_shape_where_it_stands(shape, inside, far):
    origin = '<origin xyz="1 2 3" rpy="0.3 0.2 0.1"/>'
    text = f"<collision>{origin}<geometry>{shape}</geometry></collision>"
    balls = balls_on(ElementTree.fromstring(text))
    T = origin_pose(ElementTree.fromstring(origin))
    own = (balls[:, :3] - T[:3, 3]) @ T[:3, :3]
    assert np.linalg.norm(own, axis=1).max() == pytest.approx(far)
    assert inside(own * (1 - 1e-9)).all()  # no centre outside
    points = np.random.default_rng(1).uniform(-far, far, (40_000, 3))
    points = points[inside(points)]
    away, nearest = cKDTree(own).query(points)
    assert (away <= balls[nearest, 3]).all()
    assert balls[:, 3].max() < 0.012


def test_balls_cover_a_mesh(tmp_path):
    trimesh.creation.box((0.2, 0.1, 0.003)).export(tmp_path / "plate.stl")
    name = (tmp_path / "plate.stl").as_uri()
    text = f'<collision><geometry><mesh filename="{name}"/></geometry></collision>'
    balls = balls_on(ElementTree.fromstring(text))
    points = trimesh.creation.box((0.2, 0.1, 0.003)).sample(20_000, seed=2)
    away, nearest = cKDTree(balls[:, :3]).query(points)
    assert (away <= balls[nearest, 3]).all()
    assert balls[:, 3].max() < 0.007


def test_a_link_that_cannot_be_read_is_named(tmp_path):
    """It is not taken for one that touches nothing."""
    cell = default_cell()
    lost = tmp_path / "lost.stl"
    mesh = f'<collision><geometry><mesh filename="{lost}"/></geometry></collision>'
    urdf = cell.robot.urdf.replace('<link name="z_slide">', f'<link name="z_slide">{mesh}')
    blind = replace(cell, robot=replace(cell.robot, urdf=urdf))
    check = check_robot_body(*resting(cell, 0.5 * (cell.robot.lower + cell.robot.upper)), blind,
                             silent)  # fmt: skip
    assert len(check.unread) == 1
    assert check.unread[0].startswith("link 'z_slide' is not checked: ")
    assert str(lost) in check.unread[0]


@pytest.mark.parametrize("shape", [(5, 7, 9), (1, 2, 3), (12, 12, 12)])
@pytest.mark.parametrize("reach", [1, 2, 4])
def test_the_least_value_about_a_place_is_that_of_a_filter(shape, reach):
    values = np.random.default_rng(0).integers(0, 99, shape).astype(np.int32)
    wanted = minimum_filter(values, 2 * reach + 1, mode="constant", cval=100)
    np.testing.assert_array_equal(least_about(values, reach), wanted)
