# SPDX-License-Identifier: Apache-2.0
"""Where the first loop lies: half a spacing inside the rim, and clear of what is below.

At a rim that stands on the plate or on a substrate, the bead's round side touches it
instead of going through it. What the bead cannot fill in the wedge below is handed to
the next loops, so that the volume stays right.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from vega_planner.datatypes import Floats, Patch, TriangleGeometry
from vega_planner.toolpaths.bead import ROUNDING
from vega_planner.toolpaths.distance import from_rim
from vega_planner.toolpaths.surface import Surface

#: A surface that leaves the plate at less than this sine is not moved off its rim: the
#: bead would end up far from it.
_FLATTEST = 0.25

#: The first bead is at least this much wider than high [mm], so that it has a width.
_FLAT_PART = 0.04

#: How what the first bead cannot fill is shared out to the next loops.
_SHARES = (0.5, 0.3, 0.2)


class Ground(Protocol):
    """What a rim may stand on."""

    def __call__(self, points: Floats) -> tuple[Floats, Floats]:
        """Height of points above the ground [mm], (n,), and its unit normals, (n, 3)."""


def ground_of(plate_z_mm: float, substrate: TriangleGeometry | None) -> Ground:
    """Describe the plate and the substrate on it.

    Args:
        plate_z_mm: Height of the plate in the part frame [mm].
        substrate: What stands on the plate under the part, if anything.
    """
    up = np.array([0.0, 0.0, 1.0])

    def plate(points: Floats) -> tuple[Floats, Floats]:
        return points[:, 2] - plate_z_mm, np.tile(up, (len(points), 1))

    if substrate is None:
        return plate

    from scipy.spatial import cKDTree

    centres = substrate.vertices[substrate.faces].mean(1)
    tree = cKDTree(centres)

    def both(points: Floats) -> tuple[Floats, Floats]:
        height, normal = plate(points)
        _, face = tree.query(points)
        n = substrate.face_normals[face]
        above = np.einsum("ij,ij->i", points - centres[face], n)
        nearer = np.abs(above) < np.abs(height)
        return np.where(nearer, above, height), np.where(nearer[:, None], n, normal)

    return both


@dataclass(frozen=True, eq=False)
class RimField:
    """Distance from the rim, and what the rim asks for at each vertex.

    Attributes:
        distance: Geodesic distance from the rim [mm], shape (n,).
        gradient: Its unit gradient, shape (n, 3).
        first: Distance at which the first loop lies [mm], shape (n,).
        filled: Distance up to which the first loop fills [mm], shape (n,).
        cell: Width of the strip the first bead can fill [mm], shape (n,).
    """

    distance: Floats
    gradient: Floats
    first: Floats
    filled: Floats
    cell: Floats

    @property
    def depth(self) -> float:
        """Largest distance beyond the strip of the first loop [mm]."""
        return float((self.distance - self.filled).max())

    def levels(self, spacing: float) -> Floats:
        """Loop numbers as a field: 0 on the first loop, 1 on the next, shape (n,)."""
        second = self.filled + 0.5 * spacing
        before = (self.distance - self.first) / (second - self.first)
        return np.where(self.distance < second, before, 1 + (self.distance - second) / spacing)

    def cells(self, spacing: float) -> Floats:
        """Width of the strip that a loop through each vertex has to fill [mm], (n,)."""
        level = self.levels(spacing)
        top = int(np.floor(level.max()))
        cell = np.full(len(level), spacing)
        owed = self.filled - self.cell
        shares = np.array(_SHARES[: max(top, 0)])
        if len(shares):
            for n, share in enumerate(shares / shares.sum(), start=1):
                near = np.clip(1.0 - np.abs(level - n), 0.0, 1.0)
                cell += share * near * owed
        near = np.clip(1.0 - level, 0.0, 1.0)
        return near * self.cell + (1 - near) * cell


def measure_rim(
    surface: Surface,
    patch: Patch,
    spacing: float,
    ground: Ground | None = None,
    limit: float = np.inf,
) -> RimField:
    """Measure the distance from the rim and find where the first loop has to lie.

    Args:
        surface: Connectivity of the patch.
        patch: The patch.
        spacing: Spacing of the loops [mm].
        ground: What the rim may stand on; nothing when absent.
        limit: Distances above it are not needed [mm].
    """
    count = len(surface.vertices)
    wanted = np.tile([0.5 * spacing, spacing, spacing], (count, 1))
    rim = np.unique(surface.rim_edges)
    if ground is not None and len(rim):
        wanted[rim] = _first_bead(surface, patch, rim, spacing, ground)
    distance, gradient, wanted = from_rim(surface, wanted, limit)
    distance[np.bincount(surface.faces.ravel(), minlength=len(distance)) == 0] = 0.0
    return RimField(distance, gradient, wanted[:, 0], wanted[:, 1], wanted[:, 2])


def _first_bead(
    surface: Surface, patch: Patch, rim: np.ndarray, spacing: float, ground: Ground
) -> Floats:
    """Place, end and strip of the first bead at the vertices of the rim, shape (k, 3).

    With b the direction into the patch, a the tool axis, s the direction square to it in
    the plane of the two, and n the normal of the ground, the round side of the bead, of
    radius h/2, touches the ground when its centre is h/2 sqrt((s.n)^2 + (a.n)^2) above it,
    and (w - h)/2 s.n more where the bead is w wide.
    """
    inward = _inward(surface)[rim]
    height, normal = ground(surface.vertices[rim])
    h = patch.thickness[rim]
    rise = np.einsum("ij,ij->i", inward, normal)
    along = np.einsum("ij,ij->i", patch.tool_axes[rim], normal)
    leaning = np.einsum("ij,ij->i", patch.tool_axes[rim], inward)
    side = (rise - leaning * along) / np.sqrt(np.maximum(1.0 - leaning**2, 1e-6))
    width = spacing + ROUNDING * h
    need = 0.5 * h * np.hypot(side, along) - height
    steep = rise > _FLATTEST
    centre = np.where(steep, need / np.where(steep, rise, 1.0), 0.0)
    # The flat part of the section reaches this far towards the ground for its length.
    part = np.where(steep, np.maximum(side, _FLATTEST) / np.where(steep, rise, 1.0), 1.0)
    # Where the round side of a bead half a spacing inside the rim is clear, all is well.
    touches = steep & (centre + 0.5 * (width - h) * part > 0.5 * spacing + 1e-6)
    first = np.maximum(0.5 * width, centre + 0.5 * _FLAT_PART * part)
    first = np.where(touches, np.minimum(first, centre + 0.5 * (width - h) * part), 0.5 * spacing)
    first = np.where(touches, np.maximum(first, 0.5 * spacing), first)
    own = np.where(touches, np.minimum(h + 2 * (first - centre) / part, width), width)
    cell = own - ROUNDING * h
    filled = np.where(touches, first + 0.5 * cell, spacing)
    return np.column_stack([first, filled, cell])


def _inward(surface: Surface) -> Floats:
    """Unit directions from the rim into the patch at rim vertices, else zero, (n, 3)."""
    distance, gradient, _ = from_rim(surface, limit=0.0)
    return np.where((distance == 0.0)[:, None], gradient, 0.0)
