# SPDX-License-Identifier: Apache-2.0
"""Forward kinematics of the chain from a URDF's root to the nozzle tip, and small lifts.

The driver needs to know where its tip is and to back it off; everything else about
kinematics belongs to the planner.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass

import numpy as np

from vega_planner.datatypes import Floats
from vega_planner.errors import BadRobot, Unreachable

#: Largest distance left by `lifted` [m].
LIFT_TOLERANCE = 1e-5


@dataclass(frozen=True, eq=False)
class _Link:
    """One joint of the chain: a fixed pose, then a motion about or along an axis."""

    pose: Floats
    axis: Floats
    kind: str
    index: int


@dataclass(frozen=True, eq=False)
class Chain:
    """A serial chain.

    Attributes:
        joint_names: Names of the moving joints from the base out, shape (j,).
        lower: Lowest positions [m, rad], shape (j,).
        upper: Highest positions, shape (j,).
        velocity: Highest speeds [m/s, rad/s], shape (j,).
        links: The joints' poses and axes.
    """

    joint_names: tuple[str, ...]
    lower: Floats
    upper: Floats
    velocity: Floats
    links: tuple[_Link, ...]

    def tip(self, positions: Floats) -> tuple[Floats, Floats]:
        """Place the tip.

        Args:
            positions: Joint positions [m, rad], shape (j,).

        Returns:
            The tip [m] and the unit vector from it back along the nozzle, both in the
            base frame, shape (3,).
        """
        pose = np.eye(4)
        for link in self.links:
            pose = pose @ link.pose
            if link.kind == "prismatic":
                pose[:3, 3] += pose[:3, :3] @ link.axis * positions[link.index]
            elif link.kind == "revolute":
                pose[:3, :3] = pose[:3, :3] @ _rotation(link.axis, positions[link.index])
        return pose[:3, 3].copy(), pose[:3, 2].copy()

    def lifted(self, positions: Floats, offset: Floats) -> Floats:
        """Find joint positions with the tip moved and the nozzle's direction kept.

        Newton's method on the numeric Jacobian, from where the joints are.

        Args:
            positions: Joint positions [m, rad], shape (j,).
            offset: Move of the tip in the base frame [m], shape (3,).

        Returns:
            Joint positions, shape (j,).

        Raises:
            Unreachable: If there are none near by within the limits.
        """
        place, axis = self.tip(positions)
        goal = np.r_[place + offset, axis]
        q = positions.astype(np.float64).copy()
        for _ in range(30):
            error = goal - np.r_[self.tip(q)]
            if np.abs(error).max() < LIFT_TOLERANCE:
                if (q < self.lower - 1e-9).any() or (q > self.upper + 1e-9).any():
                    break
                return q
            step = np.linalg.pinv(self._jacobian(q), rcond=1e-6) @ error
            q = q + step * min(1.0, 0.2 / max(np.abs(step).max(), 1e-12))
        raise Unreachable(f"the tip cannot be moved by {offset.tolist()} m from where it is")

    def _jacobian(self, q: Floats) -> Floats:
        small = 1e-6
        here = np.concatenate(self.tip(q))
        columns = [
            (np.concatenate(self.tip(q + small * row)) - here) / small for row in np.eye(len(q))
        ]
        return np.column_stack(columns)


def read_chain(urdf: str, tip: str = "tip") -> Chain:
    """Read the chain from the root of a URDF to a link.

    Args:
        urdf: Text of the URDF.
        tip: Name of the link at the nozzle's opening, z back along the nozzle.

    Raises:
        BadRobot: If the text is no URDF, or has no such link.
    """
    try:
        root = ET.fromstring(urdf)
    except ET.ParseError as error:
        raise BadRobot(f"the robot description cannot be read: {error}") from error
    by_child = {_of(joint, "child", "link"): joint for joint in root.findall("joint")}
    if tip not in by_child:
        names = ", ".join(str(link.get("name")) for link in root.findall("link"))
        raise BadRobot(f"link '{tip}' not in the robot description; has: {names}")
    joints = []
    link = tip
    while link in by_child:
        joints.append(by_child[link])
        link = _of(by_child[link], "parent", "link")
    links, names, bounds = [], [], []
    for joint in reversed(joints):
        kind = joint.get("type", "fixed")
        moving = kind in ("prismatic", "revolute", "continuous")
        axis = _numbers(joint, "axis", "xyz", "1 0 0")
        links.append(
            _Link(
                _pose(joint),
                axis / (np.linalg.norm(axis) or 1.0),
                "revolute" if kind == "continuous" else kind,
                len(names) if moving else -1,
            )
        )
        if moving:
            names.append(str(joint.get("name")))
            bounds.append(_bounds(joint, kind))
    if not names:
        raise BadRobot(f"no joint moves link '{tip}'")
    lower, upper, velocity = np.array(bounds).T
    return Chain(tuple(names), lower, upper, velocity, tuple(links))


def _of(joint: ET.Element, tag: str, attribute: str, default: str = "") -> str:
    child = joint.find(tag)
    return default if child is None else child.get(attribute, default)


def _numbers(joint: ET.Element, tag: str, attribute: str, default: str) -> Floats:
    text = _of(joint, tag, attribute, default)
    values = np.array([float(word) for word in text.split()])
    if values.shape != (3,):
        raise BadRobot(f"joint '{joint.get('name')}': {tag} {attribute} is '{text}'")
    return values


def _bounds(joint: ET.Element, kind: str) -> tuple[float, float, float]:
    name = joint.get("name")
    velocity = _of(joint, "limit", "velocity")
    if not velocity:
        raise BadRobot(f"joint '{name}' has no velocity limit")
    if kind == "continuous":
        return -1e6, 1e6, float(velocity)
    lower, upper = _of(joint, "limit", "lower", "0"), _of(joint, "limit", "upper", "0")
    return float(lower), float(upper), float(velocity)


def _pose(joint: ET.Element) -> Floats:
    roll, pitch, yaw = _numbers(joint, "origin", "rpy", "0 0 0")
    pose = np.eye(4)
    x, y, z = np.eye(3)
    pose[:3, :3] = _rotation(z, yaw) @ _rotation(y, pitch) @ _rotation(x, roll)
    pose[:3, 3] = _numbers(joint, "origin", "xyz", "0 0 0")
    return pose


def _rotation(axis: Floats, angle: float) -> Floats:
    """Rotate about a unit axis (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
