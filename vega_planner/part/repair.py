# SPDX-License-Identifier: Apache-2.0
"""The repair ladder: from whatever a file holds to a solid.

Each rung is taken only if the one above did not do, and says what it did: weld, drop
duplicates, turn faces, drop walls inside, fill holes, unite bodies, collapse slivers,
and at last remesh.
"""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Floats, Ints, face_cross
from vega_planner.errors import BadMesh
from vega_planner.part.overlap import overlap_depth
from vega_planner.part.topology import (
    body_labels,
    compact,
    edge_census,
    edge_uses,
    enclosed_volume,
    is_closed_surface,
)
from vega_planner.part.weld import weld_equal, weld_near
from vega_planner.progress import Progress, Report, silent

#: Vertices nearer than this share of the part's diagonal are one: the rounding of
#: single precision, many times over.
WELD_SHARE = 1e-5
#: Triangles lower than this share of the part's size have no usable normal.
SLIVER_SHARE = 1e-7
#: Holes of more than this share of the surface are no holes: the surface is loose
#: triangles, or open, and only winding numbers can tell what it means.
MOST_FILLED = 0.75
#: Overlaps no deeper than this [mm], or than a thousandth of the inside, do no harm.
HARMLESS_MM = 0.1
HARMLESS_SHARE = 1e-3


def make_solid(
    vertices: Floats, faces: Ints, report: Report = silent
) -> tuple[Floats, Ints, list[str]]:
    """Make a closed surface with outward normals that winds once round its inside.

    A mesh that is one already passes with its vertices and faces in their order.

    Args:
        vertices: Points [mm], shape (n, 3).
        faces: Vertex indices, shape (m, 3).
        report: Receives progress; may raise `Cancelled`.

    Returns:
        Vertices and faces of the solid, and what was done, a line each.

    Raises:
        BadMesh: If no solid can be made of it.
    """
    remarks: list[str] = []
    vertices, faces = weld_equal(vertices, faces)
    if not len(faces):
        raise BadMesh("no triangle has an area")
    if not is_closed_surface(faces):
        vertices, faces = _closed(vertices, faces, remarks, report)
    report(Progress("part", 0.6))
    vertices, faces = _settled(vertices, faces, remarks)
    vertices, faces = _without_slivers(vertices, faces, remarks)
    report(Progress("part", 0.7))
    depth, share = overlap_depth(vertices, faces)
    if depth > HARMLESS_MM and share > HARMLESS_SHARE:
        remarks.append(f"the surface crosses itself, up to {depth:.2g} mm deep")
        vertices, faces = _remeshed(vertices, faces, remarks, report)
    if not is_closed_surface(faces) or enclosed_volume(vertices, faces) <= 0:
        raise BadMesh("the mesh cannot be repaired into a solid")
    return vertices, faces, remarks


def _closed(
    vertices: Floats, faces: Ints, remarks: list[str], report: Report
) -> tuple[Floats, Ints]:
    """Climb the ladder until the mesh is closed and oriented."""
    from vega_planner.part.duplicates import drop_duplicates
    from vega_planner.part.holes import fill_holes
    from vega_planner.part.inner_walls import inner_walls
    from vega_planner.part.orientation import agreeing

    tolerance = WELD_SHARE * float(np.linalg.norm(np.ptp(vertices, axis=0)))
    count = len(vertices)
    vertices, faces = weld_near(vertices, faces, tolerance)
    if len(vertices) < count:
        remarks.append(
            f"{count - len(vertices)} vertices were welded to others within {tolerance:.2g} mm"
        )
    count = len(faces)
    faces = drop_duplicates(faces)
    if len(faces) < count:
        remarks.append(f"{count - len(faces)} duplicate faces were dropped")
    if not len(faces):
        raise BadMesh("the faces cancel each other")
    faces, turned = agreeing(vertices, faces)
    report(Progress("part", 0.3))
    walls = inner_walls(vertices, faces)
    if walls.any():
        faces, more = agreeing(vertices, faces[~walls])
        turned += more
        remarks.append(f"{walls.sum()} faces of walls inside were dropped")
    if turned:
        remarks.append(f"{turned} faces were turned to agree with their neighbours")
    if is_closed_surface(faces):
        return compact(vertices, faces)
    pinched = _unpinched(vertices, faces)
    if pinched is not None:
        return pinched
    filling = fill_holes(vertices, faces)
    filled = np.concatenate([faces, filling.faces])
    report(Progress("part", 0.4))
    area = 0.5 * float(np.sqrt(_length2(face_cross(vertices, faces))).sum())
    if filling.area_mm2 <= MOST_FILLED * area and (
        is_closed_surface(filled) or _unpinched(vertices, filled) is not None
    ):
        remarks.append(
            f"{filling.holes} hole(s) were filled with {filling.area_mm2:.4g} mm² of surface, "
            f"the widest {filling.widest_mm:.4g} mm"
        )
        if is_closed_surface(filled):
            return compact(vertices, filled)
        pinched = _unpinched(vertices, filled)
        assert pinched is not None
        return pinched
    census = edge_census(faces)
    remarks.append(
        f"the surface has {census.open} open, {census.crowded} crowded and {census.opposed} "
        "contradictory edges that no smaller repair closes"
    )
    return _remeshed(vertices, faces, remarks, report)


def _unpinched(vertices: Floats, faces: Ints) -> tuple[Floats, Ints] | None:
    """Take bodies apart that touch in an edge, where every edge is run both ways alike."""
    from vega_planner.part.solid import from_solid, to_solid

    order, starts, _ = edge_uses(faces)
    start = faces.reshape(-1)
    end = np.roll(faces, -1, axis=1).reshape(-1)
    sense = np.where(start < end, 1, -1)[order]
    if (np.add.reduceat(sense, starts) != 0).any():
        return None
    try:
        vertices, faces, _ = from_solid(to_solid(*compact(vertices, faces)))
    except BadMesh:
        return None
    return (vertices, faces) if is_closed_surface(faces) else None


def _settled(vertices: Floats, faces: Ints, remarks: list[str]) -> tuple[Floats, Ints]:
    """Turn a single body outward; let several be sorted out."""
    if not body_labels(faces).any():
        size = float(np.ptp(vertices, axis=0).max())
        if enclosed_volume(vertices, faces) > 1e-12 * size**3:
            return vertices, faces
    from vega_planner.part.bodies import settle_bodies

    vertices, faces, more = settle_bodies(vertices, faces)
    remarks += more
    return vertices, faces


def _without_slivers(vertices: Floats, faces: Ints, remarks: list[str]) -> tuple[Floats, Ints]:
    """Collapse triangles that have no height."""
    tolerance = SLIVER_SHARE * float(np.ptp(vertices, axis=0).max())
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    longest2 = np.maximum(np.maximum(_length2(b - a), _length2(c - b)), _length2(a - c))
    flat = _length2(np.cross(b - a, c - a)) <= tolerance**2 * longest2
    if not flat.any():
        return vertices, faces
    from vega_planner.part.solid import checked, from_solid, to_solid

    solid = checked(to_solid(vertices, faces).simplify(10 * tolerance), "collapsing slivers")
    new_vertices, new_faces, _ = from_solid(solid)
    if not is_closed_surface(new_faces):
        return vertices, faces
    remarks.append(
        f"{flat.sum()} triangles without height were collapsed; the surface moved by at most "
        f"{10 * tolerance:.2g} mm"
    )
    return new_vertices, new_faces


def _length2(vectors: Floats) -> Floats:
    return np.einsum("ij,ij->i", vectors, vectors)


def _remeshed(
    vertices: Floats, faces: Ints, remarks: list[str], report: Report
) -> tuple[Floats, Ints]:
    from vega_planner.part.remesh import remesh

    new = remesh(vertices, faces, report)
    remarks.append(
        f"the surface was made anew at {new.spacing_mm:.2g} mm: it moved by "
        f"{new.mean_mm:.2g} mm on average and {new.most_mm:.2g} mm at most"
    )
    return new.vertices, new.faces
