# SPDX-License-Identifier: Apache-2.0
"""The solid tool check against an exact one: coal on convex parts, with containment."""

from __future__ import annotations

import coal
import numpy as np
import pytest
import trimesh

from vega_planner.datatypes import TriangleGeometry
from vega_planner.printability.material import mesh_field
from vega_planner.printability.tool_shape import ToolShape

from .envelopes import default_cell

TOOL = default_cell().tool
START = 2.0


class Mesh(TriangleGeometry):
    def __init__(self, vertices, faces):
        self.vertices, self.faces = vertices, faces
        self._freeze_mesh()


def peanut() -> Mesh:
    """Two lobes with a waist, along x."""
    ball = trimesh.creation.icosphere(4)
    v = np.array(ball.vertices)
    radius = 12 - 6 * np.exp(-((v[:, 0] / 0.45) ** 2))
    return Mesh(np.column_stack([v[:, 0] * 22, v[:, 1] * radius, v[:, 2] * radius]), ball.faces)


def frustums():
    """The tool behind START as convex bodies, 96 sides, in its own frame."""
    s = np.concatenate([[START], TOOL.distance[TOOL.distance > START]])
    r = np.interp(s, TOOL.distance, TOOL.radius)
    turn = np.linspace(0, 2 * np.pi, 96, endpoint=False)
    ring = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(96)])
    bodies = []
    for s0, r0, s1, r1 in zip(s[:-1], r[:-1], s[1:], r[1:]):
        points = np.vstack([r0 * ring + [0, 0, s0], r1 * ring + [0, 0, s1]])
        hull = trimesh.convex.convex_hull(points)
        flat = coal.StdVec_Vec3s()
        flat.extend([np.array(p) for p in hull.vertices])
        triangles = coal.StdVec_Triangle()
        triangles.extend([coal.Triangle(*map(int, f)) for f in hull.faces])
        bodies.append(coal.Convex(flat, triangles))
    return bodies


def exact_hits(mesh: Mesh, tips: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """True where tool and solid share a point: surfaces meet, or the tool is inside."""
    bvh = coal.BVHModelOBBRSS()
    bvh.beginModel(len(mesh.faces), len(mesh.vertices))
    vertices = coal.StdVec_Vec3s()
    vertices.extend([np.array(v) for v in mesh.vertices])
    triangles = coal.StdVec_Triangle()
    triangles.extend([coal.Triangle(*map(int, f)) for f in mesh.faces])
    bvh.addSubModel(vertices, triangles)
    bvh.endModel()
    bodies, home = frustums(), coal.Transform3s()
    inside = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    hits = _contained(inside, tips + START * axes)
    for k in np.flatnonzero(~hits):
        u = axes[k]
        side = np.cross(u, [1.0, 0, 0] if abs(u[0]) < 0.9 else [0, 1.0, 0])
        side /= np.linalg.norm(side)
        pose = coal.Transform3s(np.column_stack([side, np.cross(u, side), u]), tips[k])
        for body in bodies:
            result = coal.CollisionResult()
            if coal.collide(bvh, home, body, pose, coal.CollisionRequest(), result):
                hits[k] = True
                break
    return hits


def _contained(mesh: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """The peanut is star-shaped about no point, but each x-section is a disc."""
    t = points[:, 0] / 22
    inside = np.abs(t) < 1
    radius = np.sqrt(np.clip(1 - t**2, 0, 1)) * (12 - 6 * np.exp(-((t / 0.45) ** 2)))
    return inside & (np.hypot(points[:, 1], points[:, 2]) < radius)


@pytest.fixture(scope="module")
def poses():
    mesh = peanut()
    rng = np.random.default_rng(7)
    face = rng.integers(0, len(mesh.faces), 8000)
    tips = mesh.vertices[mesh.faces[face]].mean(1)
    axes = mesh.face_normals[face] + 0.5 * rng.normal(size=(8000, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    return mesh, tips, axes, exact_hits(mesh, tips, axes)


def test_no_collision_is_missed_and_few_alarms_are_false(poses):
    """At 0.2 mm margin: 0 of 8000 missed, at most 4 % false."""
    mesh, tips, axes, exact = poses
    assert exact.sum() > 300
    field = mesh_field(mesh, 0.65)
    gap = field.clearance(ToolShape.of(TOOL, START), tips, axes)
    alarm = gap < 0.2
    assert (exact & ~alarm).sum() == 0
    assert (alarm & ~exact).mean() <= 0.04


def test_stopping_early_changes_no_verdict(poses):
    mesh, tips, axes, _ = poses
    field = mesh_field(mesh, 0.65)
    shape = ToolShape.of(TOOL, START)
    full = field.clearance(shape, tips, axes, 3.0)
    short = field.clearance(shape, tips, axes, 0.2, 0.2)
    assert ((full < 0.2) == (short < 0.2)).all()


def test_turning_part_and_tool_changes_clearances_by_less_than_a_voxel_s_diagonal():
    mesh = peanut()
    turn = trimesh.transformations.rotation_matrix(0.7, [1, 2, 0.5])[:3, :3]
    turned = Mesh(mesh.vertices @ turn.T, mesh.faces)
    rng = np.random.default_rng(1)
    face = rng.integers(0, len(mesh.faces), 2000)
    axes = mesh.face_normals[face]
    tips = mesh.vertices[mesh.faces[face]].mean(1) + 1.5 * axes
    shape = ToolShape.of(TOOL, START)
    a = mesh_field(mesh, 0.65).clearance(shape, tips, axes, 3.0)
    b = mesh_field(turned, 0.65).clearance(shape, tips @ turn.T, axes @ turn.T, 3.0)
    near = (a < 3) & (b < 3)
    assert np.abs(a - b)[near].max() < 0.65 * np.sqrt(3)
    assert np.abs(a - b)[near].mean() < 0.3
