# SPDX-License-Identifier: Apache-2.0
"""Parts to measure layers on: drawn by code, and meshes from a folder."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import manifold3d
import numpy as np
import trimesh
from everyday_parts import SOLIDS

from vega_planner.datatypes import Part
from vega_planner.part.load import load_part

Solid = manifold3d.Manifold


def make_part(
    name: str, solid: Solid, restrain: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> Part:
    """Turn a solid into a part.

    Args:
        name: Name of the part.
        solid: The solid.
        restrain: Given face normals and face centres, tells which faces are restrained.
    """
    mesh = solid.to_mesh64()
    vertices = np.array(np.asarray(mesh.vert_properties)[:, :3])
    faces = np.array(np.asarray(mesh.tri_verts), np.int64)
    vertices[:, 2] -= vertices[:, 2].min()
    corners = vertices[faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(cross, axis=1, keepdims=True)
    normals = cross / np.where(length > 0, length, 1)
    restrained = np.broadcast_to(restrain(normals, corners.mean(1)), len(faces))
    return Part(name, vertices, faces, restrained)


def nothing(normals: np.ndarray, centres: np.ndarray) -> np.ndarray:
    return np.zeros(len(normals), bool)


def base(normals: np.ndarray, centres: np.ndarray) -> np.ndarray:
    return (normals[:, 2] < -0.99) & (centres[:, 2] < 1e-6)


def cube(length: float, width: float, height: float) -> Solid:
    return Solid.cube((length, width, height))


def ball(radius: float, segments: int = 64) -> Solid:
    return Solid.sphere(radius, segments)


def wall(thickness: float) -> Callable[[], Part]:
    return lambda: make_part(f"wall{thickness}", cube(30, thickness, 20), base)


def ring_wall(thickness: float) -> Callable[[], Part]:
    solid = Solid.cylinder(15, 12, 12, 96) - Solid.cylinder(15, 12 - thickness, 12 - thickness, 96)
    return lambda: make_part(f"ring{thickness}", solid, base)


def wavy() -> Part:
    x, y = np.meshgrid(np.linspace(0, 40, 41), np.linspace(0, 30, 41), indexing="ij")
    z = 10.5 + 1.5 * np.sin(2 * np.pi * x / 20) * np.cos(2 * np.pi * y / 15)
    return make_part("wavy", height_field(x, y, z), base)


def height_field(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> Solid:
    """Make the solid between a height field and z = 0."""
    rows, columns = x.shape
    top = np.stack([x, y, z], -1).reshape(-1, 3)
    vertices = np.concatenate([top, top * [1, 1, 0]])
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b = number[:-1, :-1].ravel(), number[1:, :-1].ravel()
    c, d = number[1:, 1:].ravel(), number[:-1, 1:].ravel()
    n = rows * columns
    faces = [np.stack([a, b, c], 1), np.stack([a, c, d], 1)]
    faces += [np.stack([a + n, c + n, b + n], 1), np.stack([a + n, d + n, c + n], 1)]
    for rim in (number[:, 0], number[-1, :], number[::-1, -1], number[0, ::-1]):
        p, q = rim[:-1], rim[1:]
        faces += [np.stack([p, p + n, q + n], 1), np.stack([p, q + n, q], 1)]
    mesh = manifold3d.Mesh64(
        np.array(vertices, order="C"), np.array(np.concatenate(faces), np.uint64, order="C")
    )
    return Solid(mesh)


def blob(size: float, faces: int) -> Part:
    """A bumpy ball on a flat base, about `faces` triangles."""
    level = max(2, round(np.log(faces / 20) / np.log(4)))
    mesh = trimesh.creation.icosphere(level, 1.0)
    p = np.array(mesh.vertices)
    r = (
        1
        + 0.12 * np.sin(5 * p[:, 0] + 1) * np.sin(4 * p[:, 1])
        + 0.06 * np.cos(7 * p[:, 2] + p[:, 0])
    )
    p = p * r[:, None]
    p *= size / np.ptp(p, axis=0).max()
    solid = Solid(
        manifold3d.Mesh64(np.array(p, order="C"), np.array(mesh.faces, np.uint64, order="C"))
    )
    cut = p[:, 2].min() + 0.15 * np.ptp(p[:, 2])
    return make_part(f"blob{size:g}_{faces}", solid.trim_by_plane((0, 0, 1), cut), base)


def slot(gap: float) -> Part:
    solid = cube(30, 24, 20) - cube(32, gap, 20).translate((-1, 12 - gap / 2, 6))
    return make_part(
        f"slot{gap}", solid, lambda n, c: ~((np.abs(c[:, 1]) < 1e-6) & (n[:, 1] < -0.5))
    )


def round_the_slot(gap: float) -> Callable[[np.ndarray], np.ndarray]:
    """Depths in a slotted block, in closed form: behind the slot, round its lower corner."""
    right = 12 + gap / 2

    def depths(points: np.ndarray) -> np.ndarray:
        y, z = points[:, 1], points[:, 2]
        behind = (y > 12) & (z > 6)
        return np.where(behind, right + np.hypot(y - right, z - 6), y)

    return depths


#: Depths of parts where the straight way to the surface leaves the part.
DEPTHS = {f"slot{gap}": round_the_slot(gap) for gap in (2.0, 0.6)}


def hollow_dome() -> Part:
    solid = (ball(15) - ball(9)).trim_by_plane((0, 0, 1), 0)
    return make_part(
        "hollow_dome", solid, lambda n, c: (np.linalg.norm(c, axis=1) < 9.1) | base(n, c)
    )


def curved_cap() -> Part:
    """A box standing on a curved region (a bump of the print bed)."""
    solid = cube(40, 30, 15) - ball(40, 160).translate((20, 15, -34))
    return make_part(
        "curved_cap", solid,
        lambda n, c: (np.linalg.norm(c - (20, 15, -34), axis=1) < 40.01) | base(n, c),
    )  # fmt: skip


def cup(thickness: float) -> Callable[[], Part]:
    """A round vessel with walls and a floor of a thickness [mm]."""
    hollow = Solid.cylinder(20, 9 - thickness, 9 - thickness, 96).translate((0, 0, thickness))
    return lambda: make_part(f"cup{thickness}", Solid.cylinder(14, 9, 9, 96) - hollow, base)


def tray(thickness: float) -> Callable[[], Part]:
    """A vessel with four walls and a floor of a thickness [mm]."""
    hollow = cube(20 - 2 * thickness, 14 - 2 * thickness, 12)
    solid = cube(20, 14, 10) - hollow.translate((thickness, thickness, thickness))
    return lambda: make_part(f"tray{thickness}", solid, base)


def saddle() -> Part:
    """A plate on a curved base, restrained below."""
    x, y = np.meshgrid(np.linspace(-20, 20, 61), np.linspace(-15, 15, 46), indexing="ij")
    bottom = 3 + 0.008 * (x**2 - y**2)
    solid = height_field(x + 20, y + 15, bottom + 8) - height_field(x + 20, y + 15, bottom)
    return make_part("saddle", solid, lambda n, c: n[:, 2] < -0.5)


def double() -> Part:
    """Restrained below and on one side wall."""
    solid = cube(30, 24, 16) + Solid.cylinder(24, 6, 6, 64).translate((12, 12, 0))
    return make_part("double", solid, lambda n, c: base(n, c) | (c[:, 0] < 1e-6))


def two_bodies() -> Part:
    solid = cube(15, 15, 10) + ball(7).trim_by_plane((0, 0, 1), 0).translate((28, 8, 0))
    return make_part("two_bodies", solid, base)


def torus() -> Part:
    ring = Solid.revolve(manifold3d.CrossSection.circle(6, 48).translate((18, 0)), 96)
    return make_part("torus", ring, nothing)


def gear() -> Part:
    angle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    solid = Solid.cylinder(8, 14, 14, 128)
    for a in angle:
        solid += cube(5, 2.2, 8).translate((12.5, -1.1, 0)).rotate((0, 0, np.degrees(a)))
    return make_part("gear", solid - Solid.cylinder(8, 4, 4, 64), base)


def turned_box() -> Part:
    """A box off the axes, restrained on one oblique face."""
    solid = cube(30, 20, 15).rotate((30, 20, 10))
    part = make_part("turned_box", solid, nothing)
    lowest = part.face_normals[:, 2].min()
    return Part("turned_box", part.vertices, part.faces, part.face_normals[:, 2] < lowest + 1e-6)


def everyday(
    name: str, solid: str, restrain: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> Callable[[], Part]:
    """An everyday part on its base, or with no restraint region."""
    return lambda: make_part(name, SOLIDS[solid](), restrain)


PARTS: dict[str, Callable[[], Part]] = {
    "dome": lambda: make_part("dome", ball(15).trim_by_plane((0, 0, 1), 0), base),
    "sphere": lambda: make_part("sphere", ball(15), nothing),
    "box": lambda: make_part("box", cube(40, 30, 12), base),
    "box_top": lambda: make_part("box_top", cube(40, 30, 12), lambda n, c: n[:, 2] < 0.5),
    "box_top12.5": lambda: make_part(
        "box_top12.5", cube(40, 30, 12.5), lambda n, c: n[:, 2] < 0.5
    ),
    "box_full": lambda: make_part("box_full", cube(40, 30, 12), nothing),
    "turned_box": turned_box,
    "cylinder": lambda: make_part("cylinder", Solid.cylinder(20, 10, 10, 96), base),
    "cone": lambda: make_part("cone", Solid.cylinder(20, 12, 0.5, 96), base),
    "wavy": wavy,
    "channel": lambda: make_part(
        "channel", cube(30, 24, 20) - cube(32, 12, 20).translate((-1, 6, 6)), base
    ),
    "torus": torus,
    "gear": gear,
    "two_bodies": two_bodies,
    "double": double,
    "saddle": saddle,
    "curved_cap": curved_cap,
    "hollow_dome": hollow_dome,
    "slot2.0": lambda: slot(2.0),
    "slot0.6": lambda: slot(0.6),
    "blob50": lambda: blob(50, 20480),
    "blob50_80k": lambda: blob(50, 81920),
    "blob50_1M": lambda: blob(50, 1310720),
    "blob200": lambda: blob(200, 81920),
} | {f"wall{w}": wall(w) for w in (0.6, 0.8, 1.0, 1.2, 1.4, 1.6, 1.7, 2.0, 2.4, 2.8, 3.0)} | {
    f"ring{w}": ring_wall(w) for w in (0.6, 1.0, 2.0, 2.5)
} | {f"cup{w}": cup(w) for w in (0.6, 0.8, 1.0, 1.2, 1.5, 2.0, 2.5, 3.0)} | {
    f"tray{w}": tray(w) for w in (0.6, 0.8, 1.0, 1.2, 1.5, 2.0, 2.5, 3.0)
} | {name: everyday(name, name, base) for name in SOLIDS} | {
    f"{name}_full": everyday(f"{name}_full", name, nothing) for name in SOLIDS
}  # fmt: skip


def mesh_parts(folder: Path) -> dict[str, Callable[[], Part]]:
    """Name the meshes of a folder, 50 mm long."""
    makers: dict[str, Callable[[], Part]] = {}
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() in (".stl", ".obj", ".ply"):
            makers[path.stem] = lambda path=path: mesh_part(path)
    return makers


def mesh_part(path: Path) -> Part:
    """Load a mesh, scale it to 50 mm, cut off the lowest tenth and restrain the cut.

    A mesh that is no solid is repaired as `vega plan` does, and stands as that says.
    """
    loaded = trimesh.load(path, force="mesh")
    loaded = trimesh.Trimesh(loaded.vertices, loaded.faces, process=True)
    loaded.merge_vertices(merge_tex=True, merge_norm=True)
    vertices = np.array(loaded.vertices)
    vertices *= 50 / np.ptp(vertices, axis=0).max()
    mesh = manifold3d.Mesh64(
        np.array(vertices, order="C"), np.array(loaded.faces, np.uint64, order="C")
    )
    solid = Solid(mesh)
    if solid.status() != manifold3d.Error.NoError or solid.volume() < 0:
        return load_part((vertices, np.array(loaded.faces), path.stem))
    low, high = vertices[:, 2].min(), vertices[:, 2].max()
    solid = solid.trim_by_plane((0, 0, 1), float(low + 0.1 * (high - low)))
    return make_part(path.stem, solid, base)
