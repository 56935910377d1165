# SPDX-License-Identifier: Apache-2.0
"""Links of the robot against the plate: an exact check of the URDF's own geometry agrees."""

from dataclasses import replace
from xml.etree import ElementTree

import coal
import numpy as np
import pinocchio
import pytest

from vega_planner.datatypes import PrintTrajectory, Toolpath, ToolpathSet, Travel
from vega_planner.printability.robot_body import check_robot_body
from vega_planner.progress import silent
from vega_planner.robot.link_points import points_on

from .envelopes import default_cell

LINKS = ("x_carriage", "y_carriage", "z_slide", "a_bracket")


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
    """Depth of a link in the plate, by pinocchio's model of the URDF and coal."""

    def __init__(self, robot):
        self.model = pinocchio.buildModelFromXML(robot.urdf)
        kind = pinocchio.GeometryType.COLLISION
        self.shapes = pinocchio.buildGeomFromUrdfString(self.model, robot.urdf, kind)
        self.data, self.at = self.model.createData(), self.shapes.createData()
        self.robot = robot

    def depths(self, q):
        full = pinocchio.neutral(self.model)
        for name, value in zip(self.robot.joint_names, q):
            full[self.model.joints[self.model.getJointId(name)].idx_q] = value
        pinocchio.updateGeometryPlacements(self.model, self.data, self.shapes, self.at, full)
        links = [
            self.model.frames[shape.parentFrame].name for shape in self.shapes.geometryObjects
        ]
        plate = links.index("build_plate")
        deep = dict.fromkeys(LINKS, -np.inf)
        for k, link in enumerate(links):
            if link in deep:
                result = coal.DistanceResult()
                pose = [coal.Transform3s(self.at.oMg[n].rotation, self.at.oMg[n].translation)
                        for n in (k, plate)]  # fmt: skip
                gap = coal.distance(
                    self.shapes.geometryObjects[k].geometry, pose[0],
                    self.shapes.geometryObjects[plate].geometry, pose[1],
                    coal.DistanceRequest(), result,
                )  # fmt: skip
                deep[link] = max(deep[link], -1000 * gap)
        return deep


def test_links_in_the_plate_are_found_and_no_others():
    cell = default_cell()
    exact = Exact(cell.robot)
    rng = np.random.default_rng(3)
    lower, upper = cell.robot.lower, cell.robot.upper
    met = 0
    for _ in range(60):
        q = rng.uniform(lower, upper)
        q[2] = lower[2] + 0.3 * rng.uniform() * (upper[2] - lower[2])
        hits = {hit.link for hit in check_robot_body(*resting(cell, q), cell, silent).hits}
        for link, depth in exact.depths(q).items():
            if depth > 6.0:
                assert link in hits
                met += 1
            if depth < 0.0:
                assert link not in hits
    assert met > 5


@pytest.mark.parametrize(
    "shape, far, near",
    [
        ('<sphere radius="0.03"/>', 0.03, 0.03),
        ('<cylinder radius="0.03" length="0.08"/>', 0.05, 0.0),
        ('<box size="0.06 0.08 0.1"/>', np.sqrt(0.03**2 + 0.04**2 + 0.05**2), 0.03),
    ],
)
def test_points_cover_a_shape_where_it_stands(shape, far, near):
    origin = '<origin xyz="1 2 3" rpy="0.3 0.2 0.1"/>'
    text = f"<collision>{origin}<geometry>{shape}</geometry></collision>"
    away = np.linalg.norm(points_on(ElementTree.fromstring(text)) - [1, 2, 3], axis=1)
    assert away.max() == pytest.approx(far)
    assert away.min() >= near - 1e-12


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
