# SPDX-License-Identifier: Apache-2.0
"""Balls that cover the collision elements of a URDF, in the frame of their link [m].

Boxes, cylinders and spheres are filled, meshes covered on their surface. Corners and rims
are centres of balls, so that the lowest centre is the lowest point of an element.
"""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np

from vega_planner.datatypes import Floats, Ints
from vega_planner.robot.urdf_geometry import numbers, origin_pose, read_mesh

#: Spacing of the centres [m], on meshes, and the most centres that fill one element, about.
SPACING_M, MESH_SPACING_M, MOST = 0.004, 0.008, 4000

#: Rims are drawn to this [m].
SAGITTA_M = 1e-4


def balls_on(collision: ElementTree.Element) -> Floats:
    """Cover a collision element of a URDF with balls.

    Args:
        collision: A `collision` element: a box, a cylinder, a sphere or a mesh.

    Returns:
        Centres and radii in the link's frame [m], shape (n, 4).

    Raises:
        BadRobot: If a mesh file cannot be read.
        ValueError: If an element does not hold what it should.
    """
    geometry = collision.find("geometry")
    shape = geometry[0] if geometry is not None and len(geometry) else None
    if shape is None:
        return np.zeros((0, 4))
    if shape.tag == "box":
        balls = _box(numbers(shape.get("size"), "0 0 0", 3))
    elif shape.tag == "cylinder":
        balls = _cylinder(float(shape.get("radius", 0)), float(shape.get("length", 0)))
    elif shape.tag == "sphere":
        balls = _sphere(float(shape.get("radius", 0)))
    else:
        scale = numbers(shape.get("scale"), "1 1 1", 3)
        balls = _mesh(*read_mesh(shape.get("filename", ""), scale))
    T = origin_pose(collision.find("origin"))
    balls[:, :3] = balls[:, :3] @ T[:3, :3].T + T[:3, 3]
    return balls


def _line(length: float, spacing: float) -> Floats:
    return np.linspace(-0.5 * length, 0.5 * length, int(np.ceil(length / spacing - 1e-9)) + 1)


def _spacing(volume: float) -> float:
    return max(SPACING_M, (volume / MOST) ** (1 / 3))


def _box(size: Floats) -> Floats:
    spacing = _spacing(float(np.prod(size)))
    lines = [_line(length, spacing) for length in size]
    grid = np.stack(np.meshgrid(*lines, indexing="ij"), -1).reshape(-1, 3)
    cell = [length / max(len(line) - 1, 1) for length, line in zip(size, lines)]
    return np.column_stack([grid, np.full(len(grid), 0.5 * np.linalg.norm(cell))])


def _cylinder(radius: float, length: float) -> Floats:
    spacing = _spacing(np.pi * radius**2 * length)
    heights = _line(length, spacing)
    fine = np.arccos(max(1.0 - SAGITTA_M / max(radius, SAGITTA_M), -1.0))
    rings = []
    widest = 0.0
    for r in np.linspace(0.0, radius, int(np.ceil(radius / spacing)) + 1):
        count = max(1, int(np.ceil(2 * np.pi * r / spacing)))
        if r == radius:
            count = max(count, int(np.ceil(np.pi / fine)))
        turn = np.arange(count) * (2 * np.pi / count)
        rings.append(r * np.column_stack([np.cos(turn), np.sin(turn)]))
        widest = max(widest, 2 * np.pi * r / count)
    disc = np.concatenate(rings)
    along = length / max(len(heights) - 1, 1)
    across = radius / max(int(np.ceil(radius / spacing)), 1)
    # between two rings a point is at most half their gap off, and half a step along the outer
    reach = 0.5 * float(np.linalg.norm([along, across, widest]))
    points = np.column_stack([np.tile(disc, (len(heights), 1)), np.repeat(heights, len(disc))])
    return np.column_stack([points, np.full(len(points), reach)])


def _sphere(radius: float) -> Floats:
    spacing = _spacing(4.2 * radius**3)
    shells = []
    for r in np.linspace(0.0, radius, int(np.ceil(radius / spacing)) + 1):
        count = max(1, int(np.ceil(4 * np.pi * r**2 / spacing**2)))
        k = np.arange(count) + 0.5
        z, turn = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
        level = np.sqrt(1 - z * z)
        shells.append(r * np.column_stack([level * np.cos(turn), level * np.sin(turn), z]))
    points = np.concatenate(shells)
    # Fibonacci points leave gaps of less than their mean spacing
    return np.column_stack([points, np.full(len(points), 1.2 * spacing)])


def _mesh(vertices: Floats, faces: Ints) -> Floats:
    """Cover triangles with a lattice of points each, as fine as their longest edge asks."""
    corners = vertices[faces]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(1)
    steps = np.maximum(np.ceil(edges / MESH_SPACING_M), 1).astype(np.int64)
    found = []
    for count in np.unique(steps):
        i, j = np.meshgrid(np.arange(count + 1), np.arange(count + 1), indexing="ij")
        inside = i + j <= count
        a, b = i[inside] / count, j[inside] / count
        weights = np.column_stack([a, b, 1.0 - a - b])
        found.append((weights @ corners[steps == count]).reshape(-1, 3))
    points = np.concatenate(found) if found else np.zeros((0, 3))
    points = points[
        np.unique(np.round(points / 1e-3).astype(np.int64), axis=0, return_index=True)[1]
    ]
    return np.column_stack([points, np.full(len(points), 0.6 * MESH_SPACING_M + 1e-3)])
