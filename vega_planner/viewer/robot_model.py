# SPDX-License-Identifier: Apache-2.0
"""What a URDF looks like: its links as coloured triangles, its joints as a tree of frames.

Only what is drawn is read: visuals of boxes, cylinders, spheres and mesh files, their
colours, and the joints [URDF]_. Metres, radians.
"""

from __future__ import annotations

from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np

from vega_planner.datatypes import Floats, Ints
from vega_planner.errors import BadRobot
from vega_planner.robot.urdf_geometry import numbers, origin_pose, read_mesh, rotation_about

_GREY = (0.6, 0.6, 0.6, 1.0)
_SIDES = 20


@dataclass(frozen=True, eq=False)
class Visual:
    """Triangles of one colour, in the frame of their link.

    Attributes:
        vertices: Points [m], shape (n, 3).
        faces: Vertex indices, shape (m, 3).
        colour: sRGB 0..255.
        opacity: 0 to 1.
    """

    vertices: Floats
    faces: Ints
    colour: tuple[int, int, int]
    opacity: float


@dataclass(frozen=True, eq=False)
class Joint:
    """One joint.

    Attributes:
        name: As in the URDF.
        kind: "revolute", "continuous", "prismatic", "fixed" or another word of the URDF.
        parent: Link it hangs on.
        child: Link it carries.
        T_parent_joint: Pose of the joint's frame at position 0, shape (4, 4).
        axis: Unit axis in the joint's frame, shape (3,).
        mimic: Joint it follows, factor and offset, where it has one.
    """

    name: str
    kind: str
    parent: str
    child: str
    T_parent_joint: Floats
    axis: Floats
    mimic: tuple[str, float, float] | None = None

    def pose(self, position: float) -> Floats:
        """Pose of the child link in the parent link at a position [m, rad], shape (4, 4)."""
        moved = np.eye(4)
        if self.kind == "prismatic":
            moved[:3, 3] = position * self.axis
        elif self.kind in ("revolute", "continuous"):
            moved[:3, :3] = rotation_about(self.axis, position)
        return self.T_parent_joint @ moved


@dataclass(frozen=True, eq=False)
class RobotModel:
    """A robot as it is drawn.

    Attributes:
        root: Link that nothing carries.
        joints: From the root outwards: a joint's parent link is the root or the child of
            an earlier one.
        visuals: What each link looks like, by link.
    """

    root: str
    joints: tuple[Joint, ...]
    visuals: dict[str, tuple[Visual, ...]]

    def link_poses(self, positions: dict[str, float]) -> dict[str, Floats]:
        """Compute the pose of every link in the root, by link; joints left out stand at 0."""
        poses = {self.root: np.eye(4)}
        for joint in self.joints:
            pose = joint.pose(self.position(joint, positions))
            poses[joint.child] = poses[joint.parent] @ pose
        return poses

    def position(self, joint: Joint, positions: dict[str, float]) -> float:
        """Position of a joint [m, rad], also where it follows another one."""
        if joint.mimic is not None:
            leader, factor, offset = joint.mimic
            return factor * positions.get(leader, 0.0) + offset
        return positions.get(joint.name, 0.0)


def read_robot_model(urdf: str) -> RobotModel:
    """Read what is drawn of a URDF.

    Args:
        urdf: URDF text; mesh files as file:// URIs or paths.

    Raises:
        BadRobot: If it is no URDF, its links make no tree, or a mesh cannot be read.
    """
    try:
        root = ElementTree.fromstring(urdf)
        palette = {
            name: colour
            for material in root.findall("material")
            if (name := material.get("name", "")) and (colour := _colour(material))
        }
        visuals = {
            link.get("name", ""): _merged([_visual(v, palette) for v in link.findall("visual")])
            for link in root.findall("link")
        }
        joints = [_joint(joint) for joint in root.findall("joint")]
    except (ElementTree.ParseError, ValueError) as error:
        raise BadRobot(f"URDF cannot be drawn: {error}") from error
    return _tree(visuals, joints)


def quaternion_wxyz(rotation: Floats) -> Floats:
    """Unit quaternion (w, x, y, z) of a rotation matrix, w >= 0."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(rotation).as_quat()
    return np.array([w, x, y, z]) * (1.0 if w >= 0 else -1.0)


def _tree(visuals: dict[str, tuple[Visual, ...]], joints: list[Joint]) -> RobotModel:
    children = {joint.child for joint in joints}
    roots = [link for link in visuals if link not in children]
    if len(roots) != 1:
        raise BadRobot(f"URDF has {len(roots)} root links ({', '.join(roots)}); expected one")
    ordered: list[Joint] = []
    known, waiting = {roots[0]}, joints
    while waiting:
        ready = [joint for joint in waiting if joint.parent in known]
        if not ready:
            raise BadRobot(f"URDF joint '{waiting[0].name}' hangs on no known link")
        ordered += ready
        known |= {joint.child for joint in ready}
        waiting = [joint for joint in waiting if joint.parent not in known or joint not in ready]
    return RobotModel(roots[0], tuple(ordered), visuals)


def _joint(element: ElementTree.Element) -> Joint:
    parent, child = element.find("parent"), element.find("child")
    axis = element.find("axis")
    direction = numbers(axis.get("xyz") if axis is not None else None, "1 0 0", 3)
    length = np.linalg.norm(direction)
    mimic = element.find("mimic")
    return Joint(
        name=element.get("name", ""),
        kind=element.get("type", "fixed"),
        parent=parent.get("link", "") if parent is not None else "",
        child=child.get("link", "") if child is not None else "",
        T_parent_joint=origin_pose(element.find("origin")),
        axis=direction / length if length > 0 else np.array([1.0, 0.0, 0.0]),
        mimic=None
        if mimic is None
        else (
            mimic.get("joint", ""),
            float(mimic.get("multiplier", 1.0)),
            float(mimic.get("offset", 0.0)),
        ),
    )


def _visual(element: ElementTree.Element, palette: dict[str, tuple[float, ...]]) -> Visual:
    geometry = element.find("geometry")
    shape = geometry[0] if geometry is not None and len(geometry) else None
    if shape is None:
        raise ValueError("a visual has no geometry")
    vertices, faces = _shape(shape)
    T = origin_pose(element.find("origin"))
    material = element.find("material")
    colour: tuple[float, ...] = _GREY
    if material is not None:
        colour = _colour(material) or palette.get(material.get("name", ""), _GREY)
    red, green, blue = (round(255 * min(max(c, 0.0), 1.0)) for c in colour[:3])
    moved = vertices @ T[:3, :3].T + T[:3, 3]
    return Visual(moved, faces, (red, green, blue), float(colour[3]))


def _merged(visuals: list[Visual]) -> tuple[Visual, ...]:
    """Join the visuals of one colour: fewer draw calls."""
    groups: dict[tuple[tuple[int, int, int], float], list[Visual]] = {}
    for visual in visuals:
        groups.setdefault((visual.colour, visual.opacity), []).append(visual)
    joined = []
    for (colour, opacity), group in groups.items():
        starts = np.cumsum([0, *(len(v.vertices) for v in group)])[:-1]
        vertices = np.concatenate([v.vertices for v in group])
        faces = np.concatenate([v.faces + n for v, n in zip(group, starts, strict=True)])
        joined.append(Visual(vertices, faces, colour, opacity))
    return tuple(joined)


def _shape(shape: ElementTree.Element) -> tuple[Floats, Ints]:
    if shape.tag == "box":
        return _box(numbers(shape.get("size"), "0 0 0", 3))
    if shape.tag == "cylinder":
        return _rings(
            np.array([-0.5, -0.5, 0.5, 0.5]) * float(shape.get("length", 0)),
            np.array([0.0, 1.0, 1.0, 0.0]) * float(shape.get("radius", 0)),
        )
    if shape.tag == "sphere":
        tilt = np.linspace(0, np.pi, 10)
        radius = float(shape.get("radius", 0))
        return _rings(-radius * np.cos(tilt), radius * np.sin(tilt))
    if shape.tag == "mesh":
        return read_mesh(shape.get("filename", ""), numbers(shape.get("scale"), "1 1 1", 3))
    raise ValueError(f"shape '{shape.tag}' is not known; choices: box, cylinder, sphere, mesh")


def _box(size: Floats) -> tuple[Floats, Ints]:
    """Four corners for each side, so that the edges stay sharp when shaded."""
    vertices: list[Floats] = []
    faces: list[list[int]] = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            u, v = (axis + 1) % 3, (axis + 2) % 3
            start = len(vertices)
            for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                corner = np.zeros(3)
                corner[axis], corner[u], corner[v] = sign, a, b
                vertices.append(0.5 * corner * size)
            quad = [[start, start + 1, start + 2], [start, start + 2, start + 3]]
            faces += quad if sign > 0 else [triangle[::-1] for triangle in quad]
    return np.array(vertices), np.array(faces)


def _rings(heights: Floats, radii: Floats) -> tuple[Floats, Ints]:
    """Turned shape; each band has its own corners."""
    turn = np.arange(_SIDES) * 2 * np.pi / _SIDES
    circle = np.column_stack([np.cos(turn), np.sin(turn)])
    vertices, faces = [], []
    for k in range(len(heights) - 1):
        start = 2 * _SIDES * k
        for n in (k, k + 1):
            ring = np.column_stack([radii[n] * circle, np.full(_SIDES, heights[n])])
            vertices.append(ring)
        low = start + np.arange(_SIDES)
        after = start + (np.arange(_SIDES) + 1) % _SIDES
        faces.append(np.column_stack([low, after, after + _SIDES]))
        faces.append(np.column_stack([low, after + _SIDES, low + _SIDES]))
    return np.concatenate(vertices), np.concatenate(faces)


def _colour(material: ElementTree.Element) -> tuple[float, ...] | None:
    colour = material.find("color")
    return tuple(numbers(colour.get("rgba"), "", 4)) if colour is not None else None
