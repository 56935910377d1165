# SPDX-License-Identifier: Apache-2.0
"""A bowl that matches the lower side of a part.

The bowl is a block with drafted walls and a foot, minus the part grown by the clearance.
It reaches up to where the part begins to face upwards, its widest section for an egg, so
that the part can be lifted out and an ordinary printer can print the bowl.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from vega_planner.datatypes import Floats, Ints, Part, TriangleGeometry
from vega_planner.errors import BadMesh, InvalidInput

#: A base is flat where this share of the part's outline touches the plane z = 0.
FLAT_SHARE = 0.15

#: Heights [mm] and normals that count as lying on the plate.
FLAT_MM, FLAT_COSINE = 0.05, 0.98

#: Share of the part's area that may face up below the bowl's edge: bumps of the mesh.
UNDERCUT_SHARE = 0.01


@dataclass(frozen=True, eq=False)
class Substrate(TriangleGeometry):
    """A closed mesh to print on, in the part frame.

    Attributes:
        vertices: Points [mm], shape (n, 3).
        faces: Vertex indices, counter-clockwise from outside, shape (m, 3).
        height_mm: Height of the edge in the part frame.
        floor_mm: Thickness under the part's lowest point; the plate is at -floor_mm.
    """

    vertices: Floats
    faces: Ints
    height_mm: float
    floor_mm: float

    def __post_init__(self) -> None:
        self._freeze_mesh()


def stands_flat(part: Part) -> bool:
    """Tell whether a part has a planar base: enough of its outline lies on z = 0."""
    low = part.vertices[part.faces][:, :, 2].max(1) <= FLAT_MM
    flat = low & (part.face_normals[:, 2] < -FLAT_COSINE)
    return float(part.face_areas[flat].sum()) >= FLAT_SHARE * shadow_mm2(part)


def shadow_mm2(part: Part) -> float:
    """Area of the part's downward faces seen from below [mm²], an upper bound of its shadow."""
    down = np.minimum(part.face_normals[:, 2], 0.0)
    return float(-(part.face_areas * down).sum())


def bowl_height(part: Part) -> float:
    """Find the height up to which the part only widens [mm]."""
    up = part.face_normals[:, 2] > 0.02
    if not up.any():
        return float(part.bounds[1, 2])
    low = part.vertices[part.faces][:, :, 2].min(1)[up]
    order = np.argsort(low, kind="stable")
    running = np.cumsum(part.face_areas[up][order])
    first = int(np.searchsorted(running, UNDERCUT_SHARE * part.area))
    return float(low[order][min(first, len(order) - 1)])


def make_substrate(
    part: Part,
    *,
    clearance_mm: float = 0.1,
    height_mm: float | None = None,
    wall_mm: float = 3.0,
    floor_mm: float = 2.0,
    draft_deg: float = 5.0,
    foot_mm: float = 4.0,
    foot_height_mm: float = 1.2,
) -> Substrate:
    """Make the conformal substrate of a part.

    Args:
        part: The part, lowest point on z = 0.
        clearance_mm: Gap between part and substrate.
        height_mm: Height of the edge over the part's lowest point; up to the part's
            widest section when absent.
        wall_mm: Width of the edge around the part's outline.
        floor_mm: Thickness under the part's lowest point.
        draft_deg: Angle by which the outer walls widen towards the foot.
        foot_mm: How far the foot stands out around the walls, for adhesion.
        foot_height_mm: Height of the foot.

    Returns:
        A watertight mesh in the part frame, from z = -floor_mm up to its edge.

    Raises:
        InvalidInput: If a dimension is out of range.
        BadMesh: If the boolean fails.
    """
    for name, value in (
        ("clearance_mm", clearance_mm),
        ("wall_mm", wall_mm),
        ("floor_mm", floor_mm),
        ("foot_mm", foot_mm),
        ("foot_height_mm", foot_height_mm),
        ("draft_deg", draft_deg),
    ):
        if not 0 <= value < (60 if name == "draft_deg" else 200):
            raise InvalidInput(f"{name} is {value:g}; must be 0 or more and below 200 (60 deg)")
    if floor_mm <= clearance_mm:
        raise InvalidInput(
            f"floor_mm is {floor_mm:g}; must be above the clearance of {clearance_mm:g} mm"
        )
    top = bowl_height(part) if height_mm is None else float(height_mm)
    if not 0 < top <= part.bounds[1, 2]:
        raise InvalidInput(
            f"height_mm is {top:g}; the part is {part.bounds[1, 2]:g} mm high, "
            "choose a height between 0 and that"
        )
    # an edge of some height even where the part faces up at once
    top = max(top, 0.5)
    import manifold3d

    outline = _outline_below(part, top)
    block = _frustum(outline, wall_mm, wall_mm + np.tan(np.radians(draft_deg)) * top, 0.0, top)
    wide = wall_mm + np.tan(np.radians(draft_deg)) * top + foot_mm
    foot = _frustum(outline, wide, wide, -floor_mm, min(foot_height_mm - floor_mm, top))
    base = _frustum(outline, wide - foot_mm, wide - foot_mm, -floor_mm, 0.0)
    grown = part.vertices + clearance_mm * part.vertex_normals
    body = manifold3d.Manifold(
        manifold3d.Mesh64(
            vert_properties=np.ascontiguousarray(grown),
            tri_verts=part.faces.astype(np.uint64),
        )
    )
    solid = (block + foot + base) - body
    if solid.status() != manifold3d.Error.NoError or solid.is_empty():
        raise BadMesh(f"substrate of '{part.name}': the boolean failed ({solid.status()})")
    pieces = [piece for piece in solid.decompose() if piece.volume() > 1e-3]
    mesh = max(pieces, key=lambda piece: piece.volume()).to_mesh64()
    return Substrate(
        np.asarray(mesh.vert_properties)[:, :3],
        np.asarray(mesh.tri_verts).astype(np.int64),
        top,
        floor_mm,
    )


def _outline_below(part: Part, top: float) -> Floats:
    """Convex outline in x and y of the part's material below a height, shape (k, 2)."""
    from scipy.spatial import ConvexHull

    low = part.vertices[part.vertices[:, 2] <= top][:, :2]
    corners = part.vertices[part.faces]
    ends = []
    for a, b in ((0, 1), (1, 2), (2, 0)):
        za, zb = corners[:, a, 2], corners[:, b, 2]
        cross = (za - top) * (zb - top) < 0
        t = ((top - za[cross]) / (zb[cross] - za[cross]))[:, None]
        ends.append((1 - t) * corners[cross, a, :2] + t * corners[cross, b, :2])
    points = np.vstack([low, *ends])
    return points[ConvexHull(points).vertices]


def _frustum(
    outline: Floats, grow_top: float, grow_bottom: float, bottom: float, top: float
) -> Any:
    """Convex solid between an outline grown by one distance below and another above."""
    import manifold3d

    angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    layers = []
    for grow, z in ((grow_bottom, bottom), (grow_top, top)):
        points = (outline[:, None, :] + grow * ring[None]).reshape(-1, 2)
        layers.append(np.column_stack([points, np.full(len(points), z)]))
    return manifold3d.Manifold.hull_points(np.vstack(layers))
