# SPDX-License-Identifier: Apache-2.0
"""Sheets grow a little thicker beside what they leave open, where that pays.

What stays open after the core is filled lies in small pockets: in corners where three
sheets meet, along ridges where fronts meet obliquely. Each point there belongs to the
sheet that would have to grow least to reach it. A sheet grows over patches of about a
bead's width, each by as much as covers most for the material it takes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vega_planner.datatypes import Floats, Ints, Layer
from vega_planner.layers.distance_field import DistanceField
from vega_planner.parallel import map_threads

#: Width of the patches that grow by the same share, in t.
PATCH_RATIO = 0.4

#: Shares by which patches grow are multiples of this.
STEP = 0.02

#: Thickness up to which sheets grow, in t.
MOST_RATIO = 1.5

#: How much of what is found on patches beside it counts on a patch.
BESIDE_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class Patches:
    """Faces of a sheet, by the cube of a grid in which their middles lie.

    Attributes:
        of_face: The patch of each face, shape (m,).
        count: Number of patches.
        beside: Pairs of patches in cubes that share a side, shape (k, 2).
    """

    of_face: Ints
    count: int
    beside: Ints

    @classmethod
    def of_sheet(cls, sheet: Layer, width: float) -> Patches:
        """Divide a sheet into patches of a width [mm]."""
        middles = sheet.vertices[sheet.faces].mean(1)
        cubes = np.floor(middles / width).astype(np.int64)
        cubes -= cubes.min(0) - 1
        span = cubes.max(0) + 2
        steps = np.array([span[1] * span[2], span[2], 1])
        keys, of_face = np.unique(cubes @ steps, return_inverse=True)
        beside = []
        for step in steps:
            place = np.minimum(np.searchsorted(keys, keys + step), len(keys) - 1)
            pairs = np.flatnonzero(keys[place] == keys + step)
            beside.append(np.column_stack([pairs, place[pairs]]))
        return cls(of_face.ravel(), len(keys), np.concatenate(beside))

    def spread(self, values: Floats) -> Floats:
        """Add a share of what the patches beside each have, along the first axis."""
        result = values.copy()
        for here, there in ((0, 1), (1, 0)):
            rows = self.beside[:, here]
            np.add.at(result, rows, BESIDE_SHARE * values[self.beside[:, there]])
        return result


def grow(
    sheets: Sequence[Layer], points: Floats, volume: float, weight: float, t: float
) -> list[Layer]:
    """Let sheets grow towards points that none of them covers.

    Args:
        sheets: The sheets.
        points: Points that no sheet covers [mm], shape (n, 3).
        volume: Volume that each of them stands for [mm³].
        weight: How much material covering a volume is worth.
        t: Nominal layer thickness [mm].

    Returns:
        The sheets, thicker where it pays; the places of their points are the same.
    """
    reach = MOST_RATIO * t

    def measure(sheet: Layer) -> tuple[Floats, Ints]:
        if len(sheet.faces) == 0:
            return np.full(len(points), np.inf), np.zeros(len(points), np.int64)
        found = DistanceField(sheet.vertices, sheet.faces).nearest(points)
        half = sheet.thickness[sheet.faces].mean(1)[found.faces] / 2
        return np.where(found.distances < reach, found.distances - half, np.inf), found.faces

    measured = map_threads(measure, sheets)
    owner = np.argmin([missing for missing, _ in measured], axis=0)

    def grown(number: int) -> Layer:
        sheet, (missing, faces) = sheets[number], measured[number]
        mine = np.flatnonzero((owner == number) & np.isfinite(missing))
        return _grown(sheet, missing[mine], faces[mine], volume, weight, t)

    return map_threads(grown, range(len(sheets)))


def _grown(
    sheet: Layer, missing: Floats, nearest: Ints, volume: float, weight: float, t: float
) -> Layer:
    """Let one sheet grow towards the points it may cover."""
    if len(nearest) == 0:
        return sheet
    patches = Patches.of_sheet(sheet, PATCH_RATIO * t)
    half = sheet.thickness[sheet.faces].mean(1) / 2
    shares = np.arange(0.0, MOST_RATIO, STEP)
    # Place of the least share that covers a point; those beyond the last count nowhere.
    least = np.searchsorted(shares, missing / half[nearest])
    gained = np.zeros((patches.count, len(shares) + 1))
    np.add.at(gained, (patches.of_face[nearest], least), weight * volume)
    areas = sheet.face_areas
    material = np.bincount(patches.of_face, 2 * half * areas, patches.count)
    spread = patches.spread(material)
    gain = np.cumsum(patches.spread(gained)[:, :-1], axis=1) - spread[:, None] * shares
    share = patches.spread(shares[np.argmax(gain, axis=1)] * material) / spread
    at_vertices, total = np.zeros(len(sheet.vertices)), np.zeros(len(sheet.vertices))
    for corner in range(3):
        rows = sheet.faces[:, corner]
        np.add.at(at_vertices, rows, areas * share[patches.of_face])
        np.add.at(total, rows, areas)
    growth = 1 + at_vertices / np.maximum(total, 1e-12)
    growth = np.clip(growth, 1.0, np.maximum(MOST_RATIO * t / sheet.bead_thickness, 1.0))
    return replace(sheet, thickness=sheet.thickness * growth)
