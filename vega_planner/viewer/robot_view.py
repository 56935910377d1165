# SPDX-License-Identifier: Apache-2.0
"""The robot in the scene: a frame per joint, a mesh per link and colour; and the nozzle."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from vega_planner.datatypes import Floats, Ints
from vega_planner.units import mm_to_m
from vega_planner.viewer.glb import shaded_glb
from vega_planner.viewer.robot_model import RobotModel, quaternion_wxyz

DISPENSING, IDLE = (250, 120, 20), (120, 125, 130)
#: The nozzle that is drawn where no robot is: a cone 20 mm long, 0.65 to 2.2 mm wide.
_NOZZLE = ((0.0, 0.65e-3), (20e-3, 2.2e-3))


class RobotView:
    """A robot whose joints follow the print."""

    def __init__(self, scene: Any) -> None:
        """Start with no robot and a hidden nozzle."""
        self._scene = scene
        self._model: RobotModel | None = None
        self._root: Any = None
        self._frames: dict[str, Any] = {}
        self._shown: dict[str, float] = {}
        self._nozzle: Any = None
        self._bead: Any = None
        self._dispensing: bool | None = None
        self._robot_wanted = True

    @property
    def has_robot(self) -> bool:
        """Whether there is a robot to show."""
        return self._model is not None

    def show(self, model: RobotModel, T_base_part: Floats) -> None:
        """Draw a robot round the part.

        Args:
            model: The robot.
            T_base_part: Pose of the part in its base [m], shape (4, 4).
        """
        self.clear_robot()
        self._model = model
        T: Floats = np.asarray(np.linalg.inv(T_base_part), dtype=np.float64)
        self._root = self._frame("/robot", T)
        paths = {model.root: "/robot"}
        self._draw_link(model, model.root, "/robot")
        for joint in model.joints:
            path = f"{paths[joint.parent]}/{joint.name}"
            paths[joint.child] = path
            self._frames[joint.name] = self._frame(path, joint.pose(0.0))
            self._draw_link(model, joint.child, path)
        self._shown = {}
        self._root.visible = self._robot_wanted

    def clear_robot(self) -> None:
        """Take the robot out of the scene."""
        if self._root is not None:
            self._root.remove()
        self._root, self._model, self._frames = None, None, {}

    def set_joints(self, positions: Mapping[str, float]) -> None:
        """Move the joints [m, rad]; those left out stand at 0."""
        if self._model is None:
            return
        values = dict(positions)
        for joint in self._model.joints:
            value = self._model.position(joint, values)
            if joint.kind == "fixed" or self._shown.get(joint.name) == value:
                continue
            self._shown[joint.name] = value
            pose = joint.pose(value)
            frame = self._frames[joint.name]
            frame.position = pose[:3, 3]
            if joint.kind != "prismatic":
                frame.wxyz = quaternion_wxyz(pose[:3, :3])

    def set_tip(self, tip_mm: Floats, axis: Floats, dispensing: bool) -> None:
        """Put the nozzle somewhere.

        Args:
            tip_mm: Its tip [mm], part frame, shape (3,).
            axis: Unit vector from the tip back along the nozzle, shape (3,).
            dispensing: Whether material comes out.
        """
        if self._nozzle is None:
            vertices, faces = _turned(_NOZZLE)
            self._nozzle = self._add("/nozzle", vertices, faces, (225, 228, 232))
            self._nozzle.visible = not self._robot_is_shown()
        position = mm_to_m(np.asarray(tip_mm, dtype=np.float64))
        self._nozzle.position = position
        self._nozzle.wxyz = quaternion_wxyz(_turn_z_to(np.asarray(axis, dtype=np.float64)))
        if self._bead is None or self._dispensing != dispensing:
            self._dispensing = dispensing
            radius = mm_to_m(1.4 if dispensing else 0.8)
            vertices, faces = _turned(tuple(_ball(radius)))
            colour = DISPENSING if dispensing else IDLE
            self._bead = self._add("/dispenser", vertices, faces, colour)
        self._bead.position = position

    def set_visible(self, robot: bool) -> None:
        """Show the robot, or only its nozzle."""
        self._robot_wanted = robot
        if self._root is not None:
            self._root.visible = robot
        if self._nozzle is not None:
            self._nozzle.visible = not self._robot_is_shown()

    def _robot_is_shown(self) -> bool:
        return self._robot_wanted and self._model is not None

    def _frame(self, path: str, T: Floats) -> Any:
        return self._scene.add_frame(
            path, show_axes=False, position=T[:3, 3], wxyz=quaternion_wxyz(T[:3, :3])
        )

    def _draw_link(self, model: RobotModel, link: str, path: str) -> None:
        for index, visual in enumerate(model.visuals.get(link, ())):
            name = f"{path}/{link}_{index}"
            self._add(name, visual.vertices, visual.faces, visual.colour)

    def _add(self, name: str, vertices: Floats, faces: Ints, colour: tuple[int, int, int]) -> Any:
        glb = shaded_glb(vertices, faces, colour)
        return self._scene.add_glb(name, glb, cast_shadow=False, receive_shadow=False)


def _turned(profile: tuple[tuple[float, float], ...]) -> tuple[Floats, Any]:
    """A surface of revolution about z, given by heights and radii [m]."""
    turn = np.arange(16) * 2 * np.pi / 16
    circle = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(16)])
    rings = [radius * circle + [0, 0, height] for height, radius in profile]
    low, after = np.arange(16), (np.arange(16) + 1) % 16
    faces = [
        block + 16 * k
        for k in range(len(rings) - 1)
        for block in (
            np.column_stack([low, after, after + 16]),
            np.column_stack([low, after + 16, low + 16]),
        )
    ]
    return np.concatenate(rings), np.concatenate(faces)


def _ball(radius: float) -> list[tuple[float, float]]:
    """Profile of a ball: heights and radii."""
    tilt = np.linspace(0, np.pi, 9)
    return list(zip((-radius * np.cos(tilt)).tolist(), (radius * np.sin(tilt)).tolist()))


def _turn_z_to(axis: Floats) -> Floats:
    """A rotation that brings z onto a unit vector."""
    helper = np.array([1.0, 0, 0]) if abs(axis[0]) < 0.9 else np.array([0, 1.0, 0])
    x = np.cross(helper, axis)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(axis, x), axis])
