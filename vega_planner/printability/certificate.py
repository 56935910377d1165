# SPDX-License-Identifier: Apache-2.0
"""The certificate of a plan: what went in, what came out, and that it was checked."""

from __future__ import annotations

import hashlib
import json
from typing import TYPE_CHECKING, Any

import numpy as np

from vega_planner.datatypes import Part, PrintTrajectory, ToolpathSet
from vega_planner.job_digest import job_digest
from vega_planner.settings import as_dict

if TYPE_CHECKING:
    from vega_planner.printability.collisions import CollisionCheck
    from vega_planner.printability.robot_body import BodyCheck
    from vega_planner.robot.workcell import Workcell

#: Version of what is hashed and how.
VERSION = 1


def certificate(
    part: Part,
    settings: Any,
    cell: Workcell,
    toolpaths: ToolpathSet,
    trajectory: PrintTrajectory,
    check: CollisionCheck,
    body: BodyCheck,
) -> dict[str, Any]:
    """Write down what was planned and checked.

    The hashes are SHA-256 over the values' bytes (little-endian, C order), each array
    after its name, type and shape, so that equal plans have equal certificates.

    Args:
        part: The target.
        settings: Everything that was chosen.
        cell: Robot, tool, placement and substrate.
        toolpaths: Passes and travel.
        trajectory: Joint motion.
        check: Outcome of the check of every waypoint.
        body: Outcome of the check of the robot's links.

    Returns:
        A dictionary of plain values, the same for the same plan.
    """
    hashes = {
        "part": _digest(vertices=part.vertices, faces=part.faces, restrained=part.restrained),
        "settings": _text_digest(json.dumps(as_dict(settings), sort_keys=True)),
        "robot": _text_digest(cell.robot.urdf),
        "tool": _digest(distance=cell.tool.distance, radius=cell.tool.radius),
        "placement": _digest(
            T_base_part=cell.placement.T_base_part, plate_z_mm=cell.placement.plate_z_mm
        ),
        "substrate": (
            ""
            if cell.substrate is None
            else _digest(vertices=cell.substrate.vertices, faces=cell.substrate.faces)
        ),
        "toolpath": toolpath_digest(toolpaths),
        "trajectory": trajectory_digest(trajectory),
        "job": job_digest(
            trajectory.joint_names,
            trajectory.times,
            trajectory.positions,
            trajectory.velocities,
            trajectory.extrude,
            trajectory.path_id,
        ),
    }
    outcome = check.summary() | body.summary()
    return {
        "version": VERSION,
        "sha256": hashes,
        "check": outcome,
        "collision_free": check.colliding == 0 and body.touching == 0,
    }


def toolpath_digest(toolpaths: ToolpathSet) -> str:
    """Hash passes and travel."""
    hasher = hashlib.sha256()
    for path in toolpaths.passes:
        _feed(
            hasher, points=path.points, axes=path.axes, width=path.width, height=path.height,
            patch=path.patch, layer=path.layer, closed=path.closed,
        )  # fmt: skip
    for move in toolpaths.travels:
        _feed(hasher, points=move.points, axes=move.axes)
    return hasher.hexdigest()


def trajectory_digest(trajectory: PrintTrajectory) -> str:
    """Hash a joint motion: what a driver compares before it moves."""
    hasher = hashlib.sha256("\n".join(trajectory.joint_names).encode())
    _feed(
        hasher, times=trajectory.times, positions=trajectory.positions,
        velocities=trajectory.velocities, extrude=trajectory.extrude,
        path_id=trajectory.path_id, T_base_part=trajectory.T_base_part,
    )  # fmt: skip
    return hasher.hexdigest()


def _digest(**values: Any) -> str:
    hasher = hashlib.sha256()
    _feed(hasher, **values)
    return hasher.hexdigest()


def _text_digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def _feed(hasher: Any, **values: Any) -> None:
    for name, value in values.items():
        array = np.ascontiguousarray(value)
        little = array.astype(array.dtype.newbyteorder("<"), copy=False)
        hasher.update(f"{name}:{little.dtype.str}:{array.shape}\n".encode())
        hasher.update(little.tobytes())
