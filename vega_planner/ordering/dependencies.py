# SPDX-License-Identifier: Apache-2.0
"""Which patch needs which: support from below, and the nozzle's way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vega_planner.datatypes import Bools, Floats
from vega_planner.ordering.samples import Samples
from vega_planner.parallel import cores, map_threads
from vega_planner.printability.material import DistanceField, Material
from vega_planner.printability.tool_kernels import tool_hits
from vega_planner.printability.tool_shape import STEP_MM, ToolShape

#: Upward share of the normal below which a surface is a wall, and how far up its foot
#: reaches, in layer thicknesses.
WALL_RISE, FOOT_LAYERS = 0.5, 2.0


@dataclass(frozen=True, eq=False)
class Support:
    """What lies under the patches.

    Attributes:
        share: share[a, b] is the part of b's samples that lie on a, shape (n, n).
        grounded: Samples on the plate or the substrate, shape (samples,).
        floating: Samples with nothing of any patch and no ground under them, (samples,).
    """

    share: Floats
    grounded: Bools
    floating: Bools


def find_support(
    samples: Samples,
    count: int,
    material: Material,
    owner: np.ndarray,
    surroundings: DistanceField,
    plate_z_mm: float,
) -> Support:
    """Find what each patch lies on: the material one layer thickness behind it.

    Args:
        samples: Samples of the patches.
        count: Number of patches.
        material: The part's material by face.
        owner: Patch of each of the material's faces.
        surroundings: Distance field of the substrate.
        plate_z_mm: Height of the plate.
    """
    below = samples.points - samples.thickness[:, None] * samples.normals
    wall, foot = _walls(samples, count)
    # a wall stands on what is under its foot, and above that each bead on the last one
    low = np.full(count, np.inf)
    np.minimum.at(low, samples.patch, samples.points[:, 2])
    below[foot, :2] = samples.points[foot, :2]
    below[foot, 2] = (low[samples.patch] - 0.75 * samples.thickness)[foot]
    face = material.face_at(below)
    inside = material.holds(below) & (face >= 0)
    under = np.where(inside, owner[np.maximum(face, 0)], -1)
    grounded = below[:, 2] <= plate_z_mm + 0.75 * samples.thickness
    gap = surroundings.distance(below)
    grounded |= gap <= 0.75 * samples.thickness + 0.5 * surroundings.spacing
    own = under == samples.patch
    held = grounded | ((under >= 0) & ~own)
    feet = np.bincount(samples.patch[foot], minlength=count)
    firm = np.bincount(samples.patch[foot & held], minlength=count) > 0.5 * feet
    stands = wall & ~foot & firm[samples.patch]
    own |= stands
    share = np.zeros((count, count))
    good = (under >= 0) & ~own
    np.add.at(share, (under[good], samples.patch[good]), 1.0)
    share /= np.maximum(np.bincount(samples.patch[~stands], minlength=count), 1)
    return Support(share, grounded, ~grounded & ~good & ~own)


def _walls(samples: Samples, count: int) -> tuple[Bools, Bools]:
    """Mark the samples on walls, and those of them at the foot of their patch."""
    wall = np.abs(samples.normals[:, 2]) < WALL_RISE
    low = np.full(count, np.inf)
    np.minimum.at(low, samples.patch, samples.points[:, 2])
    foot = samples.points[:, 2] < low[samples.patch] + FOOT_LAYERS * samples.thickness
    return wall, wall & foot


def find_blocking(
    samples: Samples, obstacles: Samples, count: int, tool: ToolShape, margin_mm: float
) -> Floats:
    """Find which patches would stand in the nozzle's way of which.

    Args:
        samples: Tool poses of the patches.
        obstacles: Samples of the same patches as obstacles.
        count: Number of patches.
        tool: The tool.
        margin_mm: Distance it keeps.

    Returns:
        blocked[a, b], the part of a's poses whose tool meets b, shape (n, n).
    """
    pieces = np.array_split(np.arange(len(samples.points)), 4 * cores())

    def count_hits(piece: np.ndarray) -> np.ndarray:
        hits = np.zeros((count, count), np.int64)
        tool_hits(
            samples.points[piece], samples.axes[piece], samples.patch[piece], obstacles.points,
            obstacles.patch, tool.start_mm, STEP_MM, tool.samples, margin_mm, hits,
        )  # fmt: skip
        return hits

    hits = sum(map_threads(count_hits, pieces), np.zeros((count, count), np.int64))
    np.fill_diagonal(hits, 0)
    return hits / np.maximum(np.bincount(samples.patch, minlength=count), 1)[:, None]
