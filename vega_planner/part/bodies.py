# SPDX-License-Identifier: Apache-2.0
"""Several closed surfaces in one mesh: bodies, cavities, overlaps."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Floats, Ints
from vega_planner.errors import BadMesh
from vega_planner.part.solid import checked, from_solid, to_solid
from vega_planner.part.topology import body_labels, compact, enclosed_volume
from vega_planner.part.tree import TriangleTree

#: A closed surface below this share of the whole volume is debris.
DEBRIS_SHARE = 1e-7
#: Bodies nearer than this share of the part's size may touch.
TOUCHING_SHARE = 1e-6


def settle_bodies(vertices: Floats, faces: Ints) -> tuple[Floats, Ints, list[str]]:
    """Make of closed surfaces what they mean: solids with cavities, not overlapping.

    An inverted surface inside another is a cavity; elsewhere it is turned. What encloses
    nothing is dropped. Bodies that overlap, touch or lie in each other are united.

    Args:
        vertices: Points [mm], shape (n, 3).
        faces: Vertex indices of closed, oriented surfaces, shape (m, 3).

    Returns:
        Vertices, faces, and what was done.

    Raises:
        BadMesh: If nothing encloses a volume.
    """
    remarks: list[str] = []
    labels = body_labels(faces)
    shells = [faces[labels == name] for name in np.unique(labels)]
    volumes = np.array([enclosed_volume(*compact(vertices, shell)) for shell in shells])
    total = float(np.abs(volumes).sum())
    size = float(np.ptp(vertices[faces.ravel()], axis=0).max())
    debris = np.abs(volumes) <= max(DEBRIS_SHARE * total, 1e-12 * size**3)
    if debris.all():
        raise BadMesh("the surface encloses no volume")
    if debris.any():
        remarks.append(f"{debris.sum()} closed surface(s) without volume were dropped")
        shells = [shell for shell, drop in zip(shells, debris) if not drop]
        volumes = volumes[~debris]
        faces = np.concatenate(shells)
    if volumes.sum() < 0:
        remarks.append("the mesh was inside out: all faces were turned")
        shells, volumes, faces = [shell[:, ::-1] for shell in shells], -volumes, faces[:, ::-1]
    if len(shells) == 1:
        return *compact(vertices, faces), remarks
    parents = _enclosing(vertices, shells, volumes)
    turned = (volumes < 0) & (parents < 0)
    if turned.any():
        remarks.append(f"{turned.sum()} of {len(shells)} bodies were inside out and turned")
        shells = [shell[:, ::-1] if turn else shell for shell, turn in zip(shells, turned)]
        volumes = np.where(turned, -volumes, volumes)
        parents = _enclosing(vertices, shells, volumes)
    hollow = volumes < 0
    if hollow.any():
        remarks.append(
            f"{hollow.sum()} closed cavity(ies), {-volumes[hollow].sum():.4g} mm³, stay hollow"
        )
    solids = [
        np.concatenate([shells[i], *(shells[k] for k in np.flatnonzero(hollow & (parents == i)))])
        for i in np.flatnonzero(~hollow)
    ]
    if len(solids) > 1:
        if _boxes_meet(vertices, solids):
            vertices, united, remark = _united(vertices, solids)
            return vertices, united, [*remarks, *remark]
        remarks.append(f"the part is {len(solids)} separate bodies")
    return *compact(vertices, np.concatenate(shells)), remarks


def _enclosing(vertices: Floats, shells: list[Ints], volumes: Floats) -> Ints:
    """Find for each inverted shell the smallest upright shell round it, else -1."""
    parents = np.full(len(shells), -1)
    inverted = np.flatnonzero(volumes < 0)
    for outer in sorted(np.flatnonzero(volumes > 0), key=lambda i: -volumes[i]):
        box = vertices[shells[outer]].reshape(-1, 3)
        low, high = box.min(0), box.max(0)
        tree = None
        for inner in inverted:
            points = vertices[np.unique(shells[inner])[:32]]
            if (points < low).any() or (points > high).any() or inner == outer:
                continue
            tree = tree or TriangleTree(vertices, shells[outer])
            if np.median(tree.winding_numbers(points)) > 0.5:
                parents[inner] = outer
    return parents


def _boxes_meet(vertices: Floats, solids: list[Ints]) -> bool:
    corners = [vertices[solid].reshape(-1, 3) for solid in solids]
    low = np.array([c.min(0) for c in corners])
    high = np.array([c.max(0) for c in corners])
    slack = TOUCHING_SHARE * float((high.max(0) - low.min(0)).max())
    below = np.all(low[:, None] <= high[None] + slack, axis=2)
    meet = below & below.T
    return bool((meet.sum(1) > 1).any())


def _united(vertices: Floats, solids: list[Ints]) -> tuple[Floats, Ints, list[str]]:
    import manifold3d

    pieces = [to_solid(*compact(vertices, solid)) for solid in solids]
    before = sum(piece.volume() for piece in pieces)
    union = manifold3d.Manifold.batch_boolean(pieces, manifold3d.OpType.Add)
    union = checked(union, "uniting bodies")
    after = union.volume()
    area = sum(piece.surface_area() for piece in pieces)
    if after >= before * (1 - 1e-9) and union.surface_area() >= area * (1 - 1e-9):
        count = len(pieces)
        return *compact(vertices, np.concatenate(solids)), [f"the part is {count} separate bodies"]
    points, faces, _ = from_solid(union)
    return (
        points,
        faces,
        [
            f"{len(pieces)} bodies overlap or touch and were united: "
            f"{before:.4g} mm³ counted singly, {after:.4g} mm³ together"
        ],
    )
