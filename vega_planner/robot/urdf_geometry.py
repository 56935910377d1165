# SPDX-License-Identifier: Apache-2.0
"""Words of a URDF that tell where things stand and what shape they have [URDF]_; m, rad."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlparse
from xml.etree import ElementTree

import numpy as np

from vega_planner.datatypes import Floats, Ints
from vega_planner.errors import BadRobot


def rotation_about(axis: Floats, angle: float) -> Floats:
    """Rotation matrix about a unit axis, Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * (cross @ cross)


def origin_pose(element: ElementTree.Element | None) -> Floats:
    """Read an `origin` element.

    Returns:
        The pose it gives, xyz [m] and fixed-axis roll, pitch and yaw [rad], shape (4, 4);
        the identity where there is none.

    Raises:
        ValueError: If it does not hold three numbers each.
    """
    T = np.eye(4)
    if element is not None:
        T[:3, 3] = numbers(element.get("xyz"), "0 0 0", 3)
        roll, pitch, yaw = numbers(element.get("rpy"), "0 0 0", 3)
        x, y, z = np.eye(3)
        T[:3, :3] = rotation_about(z, yaw) @ rotation_about(y, pitch) @ rotation_about(x, roll)
    return T


def numbers(text: str | None, default: str, count: int) -> Floats:
    """Read numbers parted by blanks; `default` where there is no text.

    Raises:
        ValueError: If there are not `count` of them.
    """
    values = np.array([float(word) for word in (text or default).split()])
    if len(values) != count:
        raise ValueError(f"'{text}' is not {count} numbers")
    return values


def read_mesh(name: str, scale: Floats) -> tuple[Floats, Ints]:
    """Read the file of a `mesh` element.

    Args:
        name: A path or a file:// URI.
        scale: Factors along x, y and z, shape (3,).

    Returns:
        Points [m], shape (n, 3), and triangles, shape (m, 3).

    Raises:
        ValueError: If the name is another kind of URI.
        BadRobot: If the file cannot be read.
    """
    import trimesh

    place = urlparse(name)
    if place.scheme not in ("", "file"):
        raise ValueError(f"mesh '{name}' is no file; package:// paths must be resolved before")
    path = Path(unquote(place.path))
    try:
        loaded: Any = trimesh.load(path, force="mesh")
    except Exception as error:  # trimesh and its readers raise many kinds
        raise BadRobot(f"mesh {path} of the URDF cannot be read: {error}") from error
    return np.array(loaded.vertices) * scale, np.array(loaded.faces, dtype=np.int64)
