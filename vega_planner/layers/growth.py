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

#: Rings of patches about those beside a pocket that matter: growth is spread over two, and
#: weighed against the material of a third.
RINGS = 3


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

    def about(self, some: Ints) -> Patches:
        """Keep some patches and `RINGS` about them; the faces of others get -1."""
        kept = np.zeros(self.count, bool)
        kept[some] = True
        for _ in range(RINGS):
            kept[self.beside[kept[self.beside].any(1)]] = True
        number = np.where(kept, np.cumsum(kept) - 1, -1)
        beside = number[self.beside]
        return Patches(number[self.of_face], int(kept.sum()), beside[(beside >= 0).all(1)])

    def spread(self, values: Floats) -> Floats:
        """Add a share of what the patches beside each have, along the first axis."""
        result = values.copy()
        for here, there in ((0, 1), (1, 0)):
            rows = self.beside[:, here]
            np.add.at(result, rows, BESIDE_SHARE * values[self.beside[:, there]])
        return result


@dataclass(frozen=True, eq=False)
class Gaps:
    """Points that no sheet covers, and how far each sheet is from them.

    Attributes:
        volume: Volume that each point stands for [mm³].
        distances: For each sheet, distance to the points [mm], infinite beyond reach, (k, n).
        nearest: For each sheet, its nearest face to them, (k, n).
        patches: For each sheet, how it is divided.
    """

    volume: float
    distances: Floats
    nearest: Ints
    patches: tuple[Patches | None, ...]

    @classmethod
    def between(cls, sheets: Sequence[Layer], points: Floats, volume: float, t: float) -> Gaps:
        """Measure how far sheets are from points.

        Args:
            sheets: The sheets.
            points: Points that no sheet covers [mm], shape (n, 3).
            volume: Volume that each of them stands for [mm³].
            t: Nominal layer thickness [mm].
        """

        def measure(sheet: Layer) -> tuple[Floats, Ints, Patches | None]:
            distances, nearest = np.full(len(points), np.inf), np.zeros(len(points), np.int64)
            if len(sheet.faces) == 0:
                return distances, nearest, None
            reach = MOST_RATIO * t
            low, high = sheet.vertices.min(0) - reach, sheet.vertices.max(0) + reach
            about = np.flatnonzero(((points >= low) & (points <= high)).all(1))
            found = DistanceField(sheet.vertices, sheet.faces).nearest(points[about])
            distances[about] = np.where(found.distances < reach, found.distances, np.inf)
            nearest[about] = found.faces
            return distances, nearest, Patches.of_sheet(sheet, PATCH_RATIO * t)

        distances, nearest, patches = zip(*map_threads(measure, sheets))
        return cls(volume, np.array(distances), np.array(nearest), patches)

    def filled(self, sheets: Sequence[Layer], weight: float, t: float) -> tuple[Layer, ...]:
        """Let sheets grow where it pays.

        Args:
            sheets: The sheets, at the same places as when the gaps were measured.
            weight: How much material covering a volume is worth.
            t: Nominal layer thickness [mm].

        Returns:
            The sheets, thicker where it pays.
        """
        halves = [sheet.thickness[sheet.faces].mean(1) / 2 for sheet in sheets]
        missing = np.array(
            [
                distances - half[nearest] if len(half) else distances
                for distances, nearest, half in zip(self.distances, self.nearest, halves)
            ]
        )
        owner = np.argmin(missing, axis=0)
        least = missing[owner, np.arange(len(owner))]
        is_open = np.isfinite(least) & (least > 0)

        def grown(number: int) -> Layer:
            mine = np.flatnonzero((owner == number) & is_open)
            patches = self.patches[number]
            if patches is None or len(mine) == 0:
                return sheets[number]
            faces = self.nearest[number, mine]
            shares = missing[number, mine] / halves[number][faces]
            return _grown(sheets[number], patches, shares, faces, self.volume * weight, t)

        return tuple(map_threads(grown, range(len(sheets))))


def _grown(
    sheet: Layer, patches: Patches, missing: Floats, nearest: Ints, worth: float, t: float
) -> Layer:
    """Let one sheet grow towards points.

    Args:
        sheet: The sheet.
        patches: How it is divided.
        missing: The share by which it would have to grow to reach each point.
        nearest: Its face that is nearest to each point.
        worth: Material that covering one point is worth [mm³].
        t: Nominal layer thickness [mm].
    """
    patches = patches.about(np.unique(patches.of_face[nearest]))
    about = np.flatnonzero(patches.of_face >= 0)
    owner = patches.of_face[about]
    shares = np.arange(0.0, MOST_RATIO, STEP)
    # Place of the least share that covers a point; those beyond the last count nowhere.
    least = np.searchsorted(shares, missing)
    gained = np.zeros((patches.count, len(shares) + 1))
    np.add.at(gained, (patches.of_face[nearest], least), worth)
    areas, faces = sheet.face_areas[about], sheet.faces[about]
    laid = areas * sheet.thickness[faces].mean(1)
    material = np.bincount(owner, laid, patches.count).astype(np.float64)
    spread = patches.spread(material)
    gain = np.cumsum(patches.spread(gained)[:, :-1], axis=1) - spread[:, None] * shares
    share = patches.spread(shares[np.argmax(gain, axis=1)] * material) / spread
    corners, weights = faces.ravel(), np.repeat(areas, 3)
    total = np.bincount(corners, weights, len(sheet.vertices))
    at_vertices = np.bincount(corners, weights * np.repeat(share[owner], 3), len(total))
    growth = 1 + at_vertices / np.maximum(total, 1e-12)
    growth = np.clip(growth, 1.0, np.maximum(MOST_RATIO * t / sheet.bead_thickness, 1.0))
    return replace(sheet, thickness=sheet.thickness * growth)
