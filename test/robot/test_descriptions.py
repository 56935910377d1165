# SPDX-License-Identifier: Apache-2.0
"""Robots, tools and materials: found by name and by path, refused with one clear line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from vega_planner.errors import BadRobot, InvalidInput
from vega_planner.robot import load_cell, load_robot, place
from vega_planner.robot.description import expand_xacro
from vega_planner.robot.material import load_material
from vega_planner.robot.tool import load_tool
from vega_planner.settings import CellSettings
from vega_planner.shared_files import choices, shared_file


def test_the_shipped_urdf_is_the_expanded_xacro():
    shipped = shared_file("urdf", "vega5.urdf").read_text()
    assert expand_xacro(shared_file("urdf", "vega5.urdf.xacro")) == shipped


def test_vega5_takes_its_limits_from_its_configuration(vega5):
    config = yaml.safe_load(shared_file("config", "robots", "vega5.yaml").read_text())
    for k, name in enumerate(vega5.robot.joint_names):
        limits = config["joints"][name]
        assert limits["assumed"] is True
        for key in ("lower", "upper", "velocity", "acceleration"):
            assert getattr(vega5.robot, key)[k] == pytest.approx(limits[key], abs=1e-15)


def test_vega5_looks_like_a_machine_everywhere_a_tool_could_touch():
    from xml.etree import ElementTree

    root = ElementTree.parse(shared_file("urdf", "vega5.urdf")).getroot()
    for link in root.iter("link"):
        if link.get("name") != "tip":
            assert len(link.findall("visual")) == len(link.findall("collision")) > 0
            assert float(link.find("inertial/mass").get("value")) > 0


def test_the_body_behind_vega5s_tip_holds_the_default_tool():
    """The nozzle's stacked cylinders enclose the profile of the tool file, and little more."""
    from xml.etree import ElementTree

    tool = load_tool("tapered_18g")
    root = ElementTree.parse(shared_file("urdf", "vega5.urdf")).getroot()
    body = next(link for link in root.iter("link") if link.get("name") == "dispenser")
    height = np.linspace(0.05, 119.9, 800)
    radius = np.zeros_like(height)
    for part in body.findall("collision"):
        rod, origin = part.find("geometry/cylinder"), part.find("origin")
        if [float(v) for v in origin.get("rpy").split()] != [0, 0, 0]:
            continue
        centre = (float(origin.get("xyz").split()[2]) + 0.09) * 1000
        half = float(rod.get("length")) * 500
        inside = np.abs(height - centre) <= half + 1e-9
        radius[inside] = np.maximum(radius[inside], float(rod.get("radius")) * 1000)
    assert (radius >= tool.radius_at(height) - 1e-9).all()
    assert (radius <= tool.radius_at(height) + 2.6).all()


@pytest.mark.parametrize("name", ["vega5", "ur5e"])
def test_a_robots_urdf_names_plate_and_tip(name):
    robot = load_robot(name)
    assert 'link name="build_plate"' in robot.urdf
    assert 'link name="tip"' in robot.urdf


def test_a_bare_copy_of_a_known_urdf_is_recognised(tmp_path):
    import airo_models

    copy = tmp_path / "my_arm.urdf"
    copy.write_bytes(Path(airo_models.get_urdf_path("ur5e")).read_bytes())
    assert load_robot(str(copy)).joint_names == load_robot("ur5e").joint_names


def test_meshes_of_a_urdf_get_absolute_addresses():
    meshes = [part for part in load_robot("ur5e").urdf.split('"') if part.endswith(".obj")]
    assert meshes and all(part.startswith("file:///") for part in meshes)


def test_accelerations_come_from_the_urdfs_extension(ur5e):
    np.testing.assert_allclose(ur5e.robot.acceleration, 2.5)


def test_a_sidecar_describes_plate_and_nozzle(tmp_path, machine_urdf):
    path = tmp_path / "machine.urdf"
    path.write_text(machine_urdf().replace('"tip"', '"flange"').replace("build_plate", "table"))
    (tmp_path / "machine.yaml").write_text(
        "plate_frame: table\nnozzle: {parent: flange, xyz: [0, 0, -0.05], rpy: [0, 0, 0]}\n"
        "joints: {jx: {velocity: 0.3, acceleration: 2.0}}\n"
    )
    robot = load_robot(str(path))
    assert robot.velocity[0] == 0.3
    assert robot.acceleration[0] == 2.0
    tip, axis = robot.forward(np.zeros((1, 5)))
    np.testing.assert_allclose(tip[0], [0, 0, 0.2 + 0.02 - 0.06 - 0.09 - 0.05], atol=1e-12)
    np.testing.assert_allclose(axis[0], [0, 0, 1], atol=1e-12)


def test_assumed_limits_are_told(gantry):
    cell = gantry()
    assert len(cell.warnings) == 5
    assert "acceleration" in cell.warnings[0]


BROKEN = {
    "no link 'tip'": ({}, '"tip"', '"nose"'),
    "no link 'build_plate'": ({}, "build_plate", "table"),
    "not well-formed": ({}, "</robot>", ""),
    "expected <robot>": ({}, "robot", "model"),
    "must stand still": (
        {},
        '<parent link="base_link"/><child link="build_plate"/>',
        '<parent link="x"/><child link="build_plate"/>',
    ),
    "at least 5 are needed": ({"first_kind": "fixed"}, "", ""),
    "occurs 2 times": ({}, '<link name="r1">', '<link name="r2">'),
    "which does not exist": ({}, '<parent link="y"/>', '<parent link="w"/>'),
    "of type 'hinge'": ({}, 'type="revolute"', 'type="hinge"'),
    "hangs on more than one joint": ({}, '<child link="r2"/>', '<child link="r1"/>'),
    "expected a number": ({}, 'lower="-2.0"', 'lower="low"'),
    "are empty": ({"first_limits": (1.0, 1.0)}, "", ""),
}


@pytest.mark.parametrize("complaint", BROKEN)
def test_a_wrong_urdf_is_refused_in_one_line(complaint, tmp_path, machine_urdf):
    wrist, old, new = BROKEN[complaint]
    path = tmp_path / "machine.urdf"
    path.write_text(machine_urdf(**wrist).replace(old, new))
    with pytest.raises(BadRobot, match=complaint) as error:
        load_robot(str(path))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "setting, value",
    [("robot", "puma"), ("tool", "spoon"), ("material", "butter"), ("robot", "no/such.urdf")],
)
def test_an_unknown_name_is_refused_with_the_choices(setting, value):
    folder = {"robot": "robots", "tool": "tools", "material": "materials"}[setting]
    with pytest.raises(InvalidInput, match=value) as error:
        load_cell(CellSettings(**{setting: value}))
    assert all(choice in str(error.value) for choice in choices("config", folder))


@pytest.mark.parametrize(
    "text",
    [
        "bore_mm: 1.0\nprofile: {distance_mm: [0, 10], radius_mm: [1.0]}",
        "bore_mm: 1.0\nprofile: {distance_mm: [0, 10], radius_mm: [1.0, -1.0]}",
        "bore_mm: 1.0\nprofile: {distance_mm: [5, 10], radius_mm: [1.0, 1.0]}",
        "bore_mm: 0\nprofile: {distance_mm: [0, 10], radius_mm: [1.0, 1.0]}",
        "bore_mm: wide\nprofile: {distance_mm: [0, 10], radius_mm: [1.0, 1.0]}",
        "bore: 1.0",
        "- 1",
        "a: [",
    ],
)
def test_a_wrong_tool_file_is_refused(text, tmp_path):
    path = tmp_path / "tool.yaml"
    path.write_text(text)
    with pytest.raises(BadRobot) as error:
        load_tool(str(path))
    assert "\n" not in str(error.value)


def test_the_default_tool_is_the_documented_profile():
    tool = load_tool("tapered_18g")
    at = np.array([0.0, 10.0, 20.0, 25.0, 30.0, 37.5, 45.0, 100.0, 120.0])
    wanted = [0.65, 1.425, 2.2, 3.35, 4.5, 8.25, 12.0, 12.0, 12.0]
    np.testing.assert_allclose(tool.radius_at(at), wanted)
    assert tool.radius_at(-0.1) == tool.radius_at(120.1) == 0.0
    assert tool.bore_mm == 0.84


def test_the_default_material_is_the_papers():
    material = load_material("se1700")
    assert (material.pressure_kpa, material.speed_mm_s, material.bore_mm) == (130.0, 5.0, 0.84)
    assert (material.layer_thickness_mm, material.bead_width_mm) == (0.8, 1.2)


def test_the_pose_moves_and_turns_the_part_on_the_plate(vega5):
    cell = load_cell(CellSettings(pose="10,-20,5,90"))
    points, axes = cell.to_base(np.array([[1.0, 2.0, 3.0]]), np.array([[1.0, 0.0, 0.0]]))
    plate = vega5.robot.chain.T_base_plate[:3, 3]
    np.testing.assert_allclose(points[0] - plate, [0.008, -0.019, 0.008], atol=1e-15)
    np.testing.assert_allclose(axes[0], [0.0, 1.0, 0.0], atol=1e-15)
    assert cell.placement.plate_z_mm == -5.0
    back, _ = cell.to_part(points, axes)
    np.testing.assert_allclose(back, [[1.0, 2.0, 3.0]], atol=1e-12)


def test_placing_elsewhere_keeps_the_lift():
    cell = place(load_cell(CellSettings()), (0.0, 0.0, 0.0, 0.0), lift_mm=12.0)
    moved = place(cell, (5.0, 0.0, 0.0, 0.0))
    assert moved.placement.plate_z_mm == -12.0
    np.testing.assert_allclose(
        moved.placement.T_base_part[:3, 3] - cell.placement.T_base_part[:3, 3],
        [0.005, 0.0, 0.0],
        atol=1e-15,
    )


@pytest.mark.parametrize("pose", ["1,2,3", "1,2,3,x", "nan,0,0,0", ""])
def test_a_wrong_pose_is_refused(pose):
    with pytest.raises(InvalidInput, match="pose"):
        load_cell(CellSettings(pose=pose))
