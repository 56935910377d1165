# SPDX-License-Identifier: Apache-2.0
"""How much of a part its layers cover, and how much material is laid in excess."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vega_planner.datatypes import Floats, Layer, Part
from vega_planner.layers import coverage_kernels as kernels
from vega_planner.layers.grid import inside_states
from vega_planner.layers.grid_kernels import INSIDE
from vega_planner.parallel import map_threads

#: Points of the part that are looked at; more change the ratios by less than 0.001.
SAMPLES = 30000

#: Axes of the lattice of these points, aslant of the planes that parts are made of: a
#: lattice along a wall would weigh its depths unevenly.
AXES = np.linalg.qr(np.array([[0.8, -0.51, 0.31], [0.43, 0.83, 0.36], [-0.42, -0.22, 0.88]]))[0]


@dataclass(frozen=True, eq=False)
class Samples:
    """The points of a lattice that lie in a part.

    Attributes:
        origin: First point of the lattice, along its `AXES` [mm], shape (3,).
        spacing: Distance between neighbours [mm].
        shape: Points along each axis.
        inside: Nonzero for the points in the part, flat.
    """

    origin: Floats
    spacing: float
    shape: tuple[int, int, int]
    inside: np.ndarray


def spread_samples(part: Part) -> Samples:
    """Spread points over a part, to be asked which layers cover them."""
    spacing = (part.volume / SAMPLES) ** (1 / 3)
    turned = np.ascontiguousarray(part.vertices @ AXES)
    low, high = turned.min(0), turned.max(0)
    across, along, up = (int(n) for n in np.ceil((high - low) / spacing) + 2)
    shape = (across, along, up)
    origin = low - 0.37 * spacing
    state = inside_states(turned, part.faces, origin, spacing, shape)
    return Samples(origin, spacing, shape, (state == INSIDE).astype(np.uint8))


def coverage_ratios(
    part: Part, samples: Samples, sheets: tuple[Layer, ...]
) -> tuple[float, float]:
    """Compare what the sheets cover with the part.

    A sheet covers what lies within half its local thickness. The overfill is the
    material of all sheets, area times thickness, beyond the inside volume they cover.

    Args:
        part: The part.
        samples: Points of the part.
        sheets: All layers, cores included.

    Returns:
        Uncovered volume and overfill, over the part's volume.
    """
    covered = np.zeros_like(samples.inside)
    shape = np.array(samples.shape)

    def cover(sheet: Layer) -> float:
        turned = np.ascontiguousarray(sheet.vertices @ AXES)
        laid: float = kernels.cover(
            turned, sheet.faces, sheet.thickness, samples.origin, samples.spacing, shape,
            samples.inside, covered,
        )  # fmt: skip
        return laid

    # Threads only ever set marks, so their order does not matter.
    material = sum(map_threads(cover, [sheet for sheet in sheets if len(sheet.faces)]))
    count = int(samples.inside.sum())
    share = float(covered.sum()) / count if count else 0.0
    return 1.0 - share, max(0.0, material / part.volume - share)
