# SPDX-License-Identifier: Apache-2.0
"""What tests of several rooms share: machines written as URDF by formula."""

from __future__ import annotations

import pytest

LINK = (
    '<link name="{}"><inertial><mass value="1"/><inertia ixx="1e-3" iyy="1e-3" izz="1e-3" '
    'ixy="0" ixz="0" iyz="0"/></inertial></link>'
)


def joint(
    name, kind, parent, child, xyz, axis="0 0 1", limits=(-1.0, 1.0), rpy="0 0 0", speed=6.28
):
    lower, upper = limits
    limit = f'<limit lower="{lower}" upper="{upper}" velocity="{speed}" effort="1"/>'
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>'
        + ("" if kind in ("fixed",) else limit)
        + "</joint>"
    )


def gantry_urdf(
    first="0 0 1",
    second="0 1 0",
    first_limits=(-6.3, 6.3),
    second_limits=(-2.0, 2.0),
    slides=("1 0 0", "0 1 0", "0 0 1"),
    between="0 0 -0.06",
    stroke=0.25,
    first_kind="revolute",
):
    """Three linear axes, two rotary axes of any direction, and a nozzle 90 mm below."""
    links = ["base_link", "x", "y", "z", "r1", "r2", "tip", "build_plate"]
    parts = ['<robot name="gantry">', *(LINK.format(name) for name in links)]
    reach = (-stroke, stroke)
    parts += [
        joint("jx", "prismatic", "base_link", "x", "0 0 0.2", slides[0], reach, speed=0.5),
        joint("jy", "prismatic", "x", "y", "0 0 0", slides[1], reach, speed=0.5),
        joint("jz", "prismatic", "y", "z", "0 0 0", slides[2], reach, speed=0.5),
        joint("j1", first_kind, "z", "r1", "0 0 0.02", first, first_limits),
        joint("j2", "revolute", "r1", "r2", between, second, second_limits),
        joint("tip_mount", "fixed", "r2", "tip", "0 0 -0.09"),
        joint("plate_mount", "fixed", "base_link", "build_plate", "0 0 0"),
        "</robot>",
    ]
    return "\n".join(parts)


@pytest.fixture(scope="session")
def machine_urdf():
    """The function that writes a gantry machine."""
    return gantry_urdf


@pytest.fixture(scope="session")
def gantry(tmp_path_factory):
    """Make the cell of a gantry machine; arguments as of `gantry_urdf`."""
    from vega_planner.robot import load_cell
    from vega_planner.settings import CellSettings

    def make(**wrist):
        path = tmp_path_factory.mktemp("machine") / "gantry.urdf"
        path.write_text(gantry_urdf(**wrist))
        return load_cell(CellSettings(robot=str(path)))

    return make


@pytest.fixture(scope="session")
def vega5():
    from vega_planner.robot import load_cell
    from vega_planner.settings import CellSettings

    return load_cell(CellSettings(robot="vega5"))


@pytest.fixture(scope="session")
def ur5e():
    from vega_planner.robot import load_cell
    from vega_planner.settings import CellSettings

    return load_cell(CellSettings(robot="ur5e"))
