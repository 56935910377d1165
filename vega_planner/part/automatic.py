# SPDX-License-Identifier: Apache-2.0
"""Proposing a restraint region: planar faces where stacked edges do no harm.

Layers end at the restraint region, and their edges show there, stacked on each other.
On a face that the part stands on nobody sees them; on every other surface, which is
looked at or fits to something, they are what enveloping is there to avoid. So every
plane of the part is scored, and only one that the part rests on is proposed. Where
there is none, nothing is: all layers are then closed shells (full enveloping).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vega_planner.datatypes import Bools, Floats, TriangleGeometry
from vega_planner.part.regions import smooth_regions
from vega_planner.part.standing import footprint_mm2, resting_faces
from vega_planner.settings import PartSettings

#: Neighbouring faces of one plane lean less than this against each other [deg].
PLANAR_ANGLE_DEG = 0.5
#: All faces of a plane lie within this of its mean normal [deg]; a finely meshed curve
#: has small steps too, but wanders off.
FLAT_ANGLE_DEG = 1.0
#: A plane smaller than this share of the surface is a facet of something round.
SMALLEST_SHARE = 0.01
#: Score from which a plane is proposed; only what rests on the plate reaches it.
ENOUGH = 0.5
#: Shares of the footprint's box: what feet cover, and what a full base does.
FEET_SHARE = 0.05
BASE_SHARE = 0.25
#: Planes named in the explanation, besides the proposed one.
NAMED = 2


@dataclass(frozen=True, eq=False)
class PlaneScore:
    """A plane of the part and how fit it is for a restraint region.

    Attributes:
        faces: Its faces, True, shape (m,).
        area_mm2: Its area.
        normal: Its mean normal, shape (3,).
        score: 0 to 1; `ENOUGH` and above is proposed.
        reason: Why, in a few words.
    """

    faces: Bools
    area_mm2: float
    normal: Floats
    score: float
    reason: str


@dataclass(frozen=True, eq=False)
class RestraintProposal:
    """A proposed restraint region and its reasons.

    Attributes:
        faces: True for proposed faces, shape (m,); none for full enveloping.
        planes: All planes of the part, best first.
        explanation: One line for the person.
    """

    faces: Bools
    planes: tuple[PlaneScore, ...]
    explanation: str


def propose_restraint(mesh: TriangleGeometry, settings: PartSettings) -> RestraintProposal:
    """Propose the planar faces that a part rests on, or none.

    Args:
        mesh: Closed, oriented mesh placed on z = 0.
        settings: Kept for the signature of every choice; the limits are this module's.

    Returns:
        The proposal, with every plane ranked.
    """
    planes = rank_planes(mesh)
    best = planes[0] if planes else None
    if best is not None and best.score >= ENOUGH and not best.faces.all():
        passed_over = [_told(plane) for plane in planes[1 : 1 + NAMED]]
        text = (
            f"restraint auto: the flat base ({best.faces.sum()} faces, {best.area_mm2:.1f} mm², "
            f"score {best.score:.2f}): {best.reason}"
        )
        if passed_over:
            text += "; passed over: " + "; ".join(passed_over)
        return RestraintProposal(best.faces, planes, text)
    text = "restraint auto: none, all layers are closed shells: "
    if planes:
        text += "no plane is fit; passed over: " + "; ".join(
            _told(plane) for plane in planes[:NAMED]
        )
    else:
        text += "the part has no planar face"
    return RestraintProposal(np.zeros(len(mesh.faces), dtype=bool), planes, text)


def rank_planes(mesh: TriangleGeometry) -> tuple[PlaneScore, ...]:
    """Score the planes of a part, best first.

    What rests on the plate is one plane, however many feet it has.
    """
    base = resting_faces(mesh)
    planes = []
    if base.any():
        planes.append(_scored(mesh, base, rests=True))
    labels = smooth_regions(mesh, PLANAR_ANGLE_DEG)
    _, kinds = np.unique(labels, return_inverse=True)
    areas = np.bincount(kinds, weights=mesh.face_areas)
    normals = np.stack(
        [np.bincount(kinds, weights=mesh.face_areas * mesh.face_normals[:, k]) for k in range(3)],
        axis=1,
    )
    normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    straight = np.einsum("ij,ij->i", normals[kinds], mesh.face_normals)
    bent = straight < np.cos(np.radians(FLAT_ANGLE_DEG))
    crooked = np.bincount(kinds, weights=mesh.face_areas * bent) > 0.01 * areas
    large = areas >= SMALLEST_SHARE * mesh.area
    resting = np.bincount(kinds, weights=mesh.face_areas * base) > 0.5 * areas
    for kind in np.flatnonzero(large & ~crooked & ~resting):
        planes.append(_scored(mesh, kinds == kind, rests=False))
    return tuple(sorted(planes, key=lambda p: (-round(p.score, 9), -p.area_mm2, *p.normal)))


def _scored(mesh: TriangleGeometry, faces: Bools, rests: bool) -> PlaneScore:
    area = float(mesh.face_areas[faces].sum())
    normal = mesh.face_areas[faces] @ mesh.face_normals[faces]
    normal = normal / max(float(np.linalg.norm(normal)), 1e-300)
    if rests:
        share = area / max(footprint_mm2(mesh), 1e-300)
        score = 0.2 + 0.4 * min(1.0, share / FEET_SHARE) + 0.4 * min(1.0, share / BASE_SHARE)
        hides = "the part rests on it and hides the edges"
        if score < ENOUGH:
            hides = "the part rests on it, but it is small and would be crowded with edges"
        return PlaneScore(faces, area, normal, score, hides)
    share = min(1.0, area / mesh.area)
    if normal[2] < -0.9:
        return PlaneScore(faces, area, normal, 0.3 + 0.1 * share, "it hangs over the plate")
    if normal[2] > 0.9:
        return PlaneScore(faces, area, normal, 0.1 + 0.1 * share, "it is looked at from above")
    return PlaneScore(faces, area, normal, 0.2 + 0.1 * share, "it is a side that shows")


def _told(plane: PlaneScore) -> str:
    x, y, z = (float(f"{value:.2f}") + 0.0 for value in plane.normal)
    return (
        f"normal:{x:g},{y:g},{z:g} ({plane.area_mm2:.1f} mm², score {plane.score:.2f}): "
        f"{plane.reason}"
    )
