# SPDX-License-Identifier: Apache-2.0
"""A bowl that matches the lower side of a part.

The bowl is a block with drafted walls and a foot, minus the part grown by the clearance.
It fills what is under the part's lower side, as seen from below, and its edge follows the
rim of that side, the widest section of an egg, so that the part can be lifted out, the
nozzle reaches all that faces up, and an ordinary printer can print the bowl.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from vega_planner.datatypes import Floats, Ints, Part, TriangleGeometry
from vega_planner.errors import BadMesh, InvalidInput
from vega_planner.part.topology import connected_pieces
from vega_planner.printability.line_of_sight import Occluder
from vega_planner.substrate.skirts import rim_edges, skirts

#: A base is flat where this share of the part's outline touches the plane z = 0.
FLAT_SHARE = 0.15

#: Heights [mm] and normals that count as lying on the plate.
FLAT_MM, FLAT_COSINE = 0.05, 0.98

#: Pieces of the lower side are carried where they come this near to the plate [mm] and
#: hold this share of all that do.
NEAR_PLATE_MM, LEAST_SHARE = 1.0, 0.02


@dataclass(frozen=True, eq=False)
class Substrate(TriangleGeometry):
    """A closed mesh to print on, in the part frame.

    Attributes:
        vertices: Points [mm], shape (n, 3).
        faces: Vertex indices, counter-clockwise from outside, shape (m, 3).
        height_mm: Largest height of the edge in the part frame.
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


def lower_side(part: Part) -> Ints:
    """Find the faces a substrate carries: they face down, are seen from below, and belong
    to a piece that comes down near the plate.

    Returns:
        Face indices.

    Raises:
        BadMesh: If there is none.
    """
    down = np.flatnonzero(part.face_normals[:, 2] < -0.02)
    centres = part.vertices[part.faces[down]].mean(1)
    below = np.tile([0.0, 0.0, -1.0], (len(down), 1))
    down = down[~Occluder(part).blocks(centres, below)]
    piece, count = connected_pieces(len(part.vertices), part.faces[down])
    low = np.full(count, np.inf)
    np.minimum.at(low, piece, part.vertices[part.faces[down]][:, :, 2].min(1))
    area = np.bincount(piece, part.face_areas[down], count)
    near = low <= NEAR_PLATE_MM
    near &= area > LEAST_SHARE * area[near].sum()
    kept = down[near[piece]]
    if not len(kept):
        raise BadMesh(f"part '{part.name}' has no lower side a substrate could carry")
    return kept


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
        height_mm: Largest height of the edge over the part's lowest point; the rim of
            the part's lower side when absent.
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
    if height_mm is not None and not 0 < height_mm <= part.bounds[1, 2]:
        raise InvalidInput(
            f"height_mm is {height_mm:g}; the part is {part.bounds[1, 2]:g} mm high, "
            "choose a height between 0 and that"
        )
    import manifold3d

    side = part.faces[lower_side(part)]
    top = float(part.vertices[side.ravel(), 2].max())
    if height_mm is not None:
        top = min(top, float(height_mm))
    top = max(top, 0.5)
    drafted = wall_mm + np.tan(np.radians(draft_deg)) * top
    wide = drafted + foot_mm
    outline = _outline_below(part, top)
    block = _frustum(outline, drafted, wall_mm, 0.0, top)
    foot = _frustum(outline, wide, wide, -floor_mm, min(foot_height_mm - floor_mm, top))
    base = _frustum(outline, drafted, drafted, -floor_mm, 0.0)
    high = float(part.bounds[1, 2]) + 5.0
    above = _extruded(part.vertices - [0, 0, clearance_mm], side, None, high)
    shadow = _extruded(part.vertices, side, -floor_mm - 5.0, high + 1.0)
    grown = part.vertices + clearance_mm * part.vertex_normals
    body = manifold3d.Manifold(
        manifold3d.Mesh64(
            vert_properties=np.ascontiguousarray(grown), tri_verts=part.faces.astype(np.uint64)
        )
    )
    over_rim = skirts(part.vertices, side, 2.0 * wide + 5.0, high) - shadow
    solid = (block + foot + base) - body - above - over_rim
    if solid.status() != manifold3d.Error.NoError or solid.is_empty():
        raise BadMesh(f"substrate of '{part.name}': the boolean failed ({solid.status()})")
    return Substrate(*_largest_piece(solid.to_mesh64()), top, floor_mm)


def _largest_piece(mesh: Any) -> tuple[Floats, Ints]:
    """The vertices and faces of the connected piece with the largest volume."""
    vertices = np.asarray(mesh.vert_properties)[:, :3]
    faces = np.asarray(mesh.tri_verts).astype(np.int64)
    piece, count = connected_pieces(len(vertices), faces)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    volume = np.bincount(piece, np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0, count)
    used, new = np.unique(faces[piece == np.argmax(volume)], return_inverse=True)
    return vertices[used], new.reshape(-1, 3)


def _extruded(vertices: Floats, faces: Ints, bottom: float | None, top: float) -> Any:
    """Solid between a sheet that faces down and a plane above it.

    Args:
        vertices: Points [mm], shape (n, 3).
        faces: The sheet's faces, shape (m, 3).
        bottom: Height the sheet is flattened to; as it is when None.
        top: Height of the plane.
    """
    import manifold3d

    used, new = np.unique(faces, return_inverse=True)
    sheet = new.reshape(-1, 3)
    low = vertices[used].copy()
    if bottom is not None:
        low[:, 2] = bottom
    high = low.copy()
    high[:, 2] = top
    count = len(used)
    a, b = rim_edges(sheet).T
    sides = np.concatenate(
        [np.column_stack([b, a, a + count]), np.column_stack([b, a + count, b + count])]
    )
    mesh = np.concatenate([sheet, sheet[:, ::-1] + count, sides])
    return manifold3d.Manifold(
        manifold3d.Mesh64(
            vert_properties=np.concatenate([low, high]), tri_verts=mesh.astype(np.uint64)
        )
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
    outline: Floats, grow_bottom: float, grow_top: float, bottom: float, top: float
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
