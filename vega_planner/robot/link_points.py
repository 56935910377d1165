# SPDX-License-Identifier: Apache-2.0
"""Points that cover the collision elements of a URDF, in the frame of their link [m]."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np

from vega_planner.datatypes import Floats
from vega_planner.robot.urdf_geometry import numbers, origin_pose, read_mesh

#: Spacing of the points on boxes, cylinders and spheres [m]; points taken of a mesh.
SPACING_M, MESH_POINTS = 0.006, 400


def points_on(collision: ElementTree.Element) -> Floats:
    """Cover a collision element of a URDF with points.

    Args:
        collision: A `collision` element: a box, a cylinder, a sphere or a mesh.

    Returns:
        Points in the link's frame [m], shape (n, 3).

    Raises:
        BadRobot: If a mesh file cannot be read.
        ValueError: If an element does not hold what it should.
    """
    geometry = collision.find("geometry")
    shape = geometry[0] if geometry is not None and len(geometry) else None
    if shape is None:
        return np.zeros((0, 3))
    if shape.tag == "box":
        points = _box(numbers(shape.get("size"), "0 0 0", 3))
    elif shape.tag == "cylinder":
        points = _cylinder(float(shape.get("radius", 0)), float(shape.get("length", 0)))
    elif shape.tag == "sphere":
        points = _sphere(float(shape.get("radius", 0)))
    else:
        scale = numbers(shape.get("scale"), "1 1 1", 3)
        corners = np.unique(read_mesh(shape.get("filename", ""), scale)[0], axis=0)
        points = corners[:: max(1, len(corners) // MESH_POINTS)]
    T = origin_pose(collision.find("origin"))
    return points @ T[:3, :3].T + T[:3, 3]


def _steps(length: float) -> int:
    return max(2, min(60, int(np.ceil(length / SPACING_M)) + 1))


def _box(size: Floats) -> Floats:
    lines = [np.linspace(-0.5 * x, 0.5 * x, _steps(x)) for x in size]
    grid = np.stack(np.meshgrid(*lines, indexing="ij"), -1).reshape(-1, 3)
    outside = (np.abs(grid) >= 0.5 * size - 1e-12).any(1)
    return grid[outside]


def _cylinder(radius: float, length: float) -> Floats:
    turn = np.linspace(0, 2 * np.pi, max(12, _steps(2 * np.pi * radius)), endpoint=False)
    ring = np.column_stack([np.cos(turn), np.sin(turn)])
    rows = [
        np.column_stack([radius * ring, np.full(len(ring), z)])
        for z in np.linspace(-0.5 * length, 0.5 * length, _steps(length))
    ]
    for r in np.linspace(0, radius, _steps(radius))[:-1]:
        for z in (-0.5 * length, 0.5 * length):
            rows.append(np.column_stack([r * ring, np.full(len(ring), z)]))
    return np.concatenate(rows)


def _sphere(radius: float) -> Floats:
    count = max(24, int(4 * np.pi * radius**2 / SPACING_M**2))
    k = np.arange(count) + 0.5
    z, turn = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    level = np.sqrt(1 - z * z)
    return radius * np.column_stack([level * np.cos(turn), level * np.sin(turn), z])
