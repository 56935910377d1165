# SPDX-License-Identifier: Apache-2.0
"""Evenly spread samples of patches, the same every time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vega_planner.datatypes import Floats, Ints, Patch

#: Area one sample stands for [mm²], and the most samples taken of all patches together.
AREA_MM2, MOST = 6.0, 6000

#: Samples every patch gets at least, where it has so many faces: of few patches, of many.
LEAST, FEWEST = 24, 6


@dataclass(frozen=True, eq=False)
class Samples:
    """Points of patches, each at the middle of a face.

    Attributes:
        points: Positions [mm], shape (n, 3).
        normals: Unit normals towards the nozzle, shape (n, 3).
        axes: Unit tool axes, shape (n, 3).
        thickness: Layer thickness [mm], shape (n,).
        patch: Index of the patch, rising, shape (n,).
        area: Area each stands for [mm²], shape (n,).
    """

    points: Floats
    normals: Floats
    axes: Floats
    thickness: Floats
    patch: Ints
    area: Floats


def sample_patches(patches: Sequence[Patch], most: int = MOST) -> Samples:
    """Sample patches evenly by area.

    Args:
        patches: What to sample.
        most: Number of samples aimed at for all together.
    """
    total = sum(patch.area for patch in patches)
    each = max(AREA_MM2, total / most)
    least = int(np.clip(2 * most / len(patches), FEWEST, LEAST))
    parts = []
    for number, patch in enumerate(patches):
        area = patch.face_areas
        running = np.cumsum(area)
        count = int(np.clip(np.ceil(running[-1] / each), min(least, len(area)), None))
        at = (np.arange(count) + 0.5) * running[-1] / count
        chosen = np.minimum(np.searchsorted(running, at), len(area) - 1)
        corners = patch.faces[chosen]
        axes = patch.tool_axes[corners].sum(1)
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        parts.append(
            (
                patch.vertices[corners].mean(1),
                patch.face_normals[chosen],
                axes,
                patch.thickness[corners].mean(1),
                np.full(count, number),
                np.full(count, running[-1] / count),
            )
        )
    return Samples(*(np.concatenate(values) for values in zip(*parts)))
