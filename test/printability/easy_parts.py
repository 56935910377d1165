# SPDX-License-Identifier: Apache-2.0
"""Parts on a flat base that anyone would expect to be printable, drawn by code [mm]."""

from __future__ import annotations

import numpy as np
import trimesh
from shapely.geometry import Polygon
from trimesh import creation


def arc(radius, begin_deg, end_deg, count=24, squash=1.0):
    turn = np.radians(np.linspace(begin_deg, end_deg, count))
    return [(radius * np.cos(t), squash * radius * np.sin(t)) for t in turn]


def revolved(profile):
    return creation.revolve(np.array(profile, float), sections=48)


def prism(outline, height):
    return creation.extrude_polygon(Polygon(outline), height)


def block(size, at):
    body = creation.box(size)
    body.apply_translation(at)
    return body


def union(*bodies):
    return trimesh.boolean.union(bodies, engine="manifold")


def cube():
    return creation.box((12, 12, 12))


def half_torus():
    ring = creation.torus(12, 5, major_sections=48, minor_sections=24)
    return trimesh.intersections.slice_mesh_plane(ring, [0, 0, 1], [0, 0, 0], cap=True)


def wedge():
    body = prism([(0, 0), (20, 0), (20, 3), (0, 12)], 12)
    body.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0]))
    return body


def pyramid():
    foot = [[-10, -10, 0], [10, -10, 0], [10, 10, 0], [-10, 10, 0], [0, 0, 14.0]]
    return trimesh.convex.convex_hull(np.array(foot))


def hexagon_nut():
    hole = creation.cylinder(6, 12, sections=48)
    return trimesh.boolean.difference(
        [creation.cylinder(12, 10, sections=6), hole], engine="manifold"
    )


#: Name: how to draw it, and the layer thickness [mm].
EASY = {
    "box": (lambda: creation.box((18, 14, 8)), 0.8),
    "cube, thin layers": (cube, 0.4),
    "cube": (cube, 0.8),
    "cube, thick layers": (cube, 1.2),
    "cube, thickest layers": (cube, 1.6),
    "cylinder": (lambda: creation.cylinder(8, 12, sections=48), 0.8),
    "cone": (lambda: creation.cone(10, 15, sections=48), 0.8),
    "hemisphere": (lambda: revolved([(0, 0), *arc(10, 0, 90)]), 0.8),
    "dome": (lambda: revolved([(0, 0), *arc(14, 0, 90, squash=0.4)]), 0.8),
    "half egg": (lambda: revolved([(0, 0), *arc(8, 0, 90, squash=1.6)]), 0.8),
    "pyramid": (pyramid, 0.8),
    "L": (lambda: prism([(0, 0), (20, 0), (20, 8), (8, 8), (8, 20), (0, 20)], 8), 0.8),
    "L standing": (
        lambda: union(block((20, 10, 6), (0, 0, 3)), block((7, 10, 14), (-6.5, 0, 7))),
        0.8,
    ),
    "tube": (lambda: creation.annulus(9, 13, 10, sections=48), 0.8),
    "cup": (
        lambda: revolved([(0, 0), (15, 0), (15, 20), (11.6, 20), (11.6, 3.2), (0, 3.2)]),
        0.8,
    ),
    "hexagon nut": (hexagon_nut, 0.8),
    "steps": (lambda: union(block((20, 20, 5), (0, 0, 2.5)), block((10, 10, 10), (0, 0, 5))), 0.8),
    "wedge": (wedge, 0.8),
    "half torus": (half_torus, 0.8),
    "two bodies": (
        lambda: trimesh.util.concatenate(
            [block((9, 9, 7), (-9, 0, 3.5)), block((9, 9, 7), (9, 0, 3.5))]
        ),
        0.8,
    ),
}  # fmt: skip


def draw(name, folder):
    """Write one of them on z = 0 as STL; return its path and layer thickness."""
    make, thickness = EASY[name]
    body = make()
    body.apply_translation([0, 0, -body.bounds[0, 2]])
    path = folder / "part.stl"
    body.export(path)
    return path, thickness
