# SPDX-License-Identifier: Apache-2.0
"""Proposing a restraint region: planar faces where stacked edges do no harm.

Where layers end at the restraint region their edges show, stacked on each other. That
does no harm on a face the part stands on, and harms every surface that is looked at or
fits to something. So the proposal is the flat face on the plate, or nothing: then all
layers are closed shells (full enveloping).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vega_planner.datatypes import Bools, TriangleGeometry
from vega_planner.part.regions import smooth_regions
from vega_planner.settings import PartSettings

#: Faces of one plane lean less than this against each other [deg].
PLANAR_ANGLE_DEG = 0.5
#: A plane smaller than this share of the surface is a facet of something round.
SMALLEST_SHARE = 0.01
#: Score from which a plane is proposed.
ENOUGH = 0.5


@dataclass(frozen=True, eq=False)
class RestraintProposal:
    """A proposed restraint region and its reasons.

    Attributes:
        faces: True for proposed faces, shape (m,).
        score: Score of the best plane, 0 to 1.
        explanation: One line for the person.
    """

    faces: Bools
    score: float
    explanation: str


def propose_restraint(mesh: TriangleGeometry, settings: PartSettings) -> RestraintProposal:
    """Propose the planar faces that a part can stand on, or none.

    Args:
        mesh: Closed, oriented mesh placed on z = 0.
        settings: For the angle of smooth regions.

    Returns:
        The proposal; its region is empty where no plane on the plate is fit.
    """
    labels = smooth_regions(mesh, PLANAR_ANGLE_DEG)
    _, kinds = np.unique(labels, return_inverse=True)
    areas = np.bincount(kinds, weights=mesh.face_areas)
    heights = mesh.vertices[mesh.faces][:, :, 2].max(1)
    tops = np.full(len(areas), -np.inf)
    np.maximum.at(tops, kinds, heights)
    fit = (tops < 0.02) & (areas > SMALLEST_SHARE * mesh.area)
    chosen = fit[kinds]
    if not chosen.any():
        return RestraintProposal(chosen, 0.0, "restraint auto: none, no planar face on the plate")
    area = float(mesh.face_areas[chosen].sum())
    return RestraintProposal(
        chosen, 1.0, f"restraint auto: the flat base, {chosen.sum()} faces, {area:.1f} mm²"
    )
