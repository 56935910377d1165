# SPDX-License-Identifier: Apache-2.0
"""The outer surface of a print, as a scanner sees it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vega_planner.assess import sight_kernels as kernels
from vega_planner.assess.bead_kernels import STEPS
from vega_planner.assess.field import Field, Grid

#: A scanner looks through openings wider than twice this [mm].
PROBE_MM = 0.1
#: It sees this far beyond the place where such a ball still fits: to the bottom of the
#: groove between two beads, and not along a tunnel [mm].
DEPTH_MM = 0.5
#: Smaller voids are rounding of the grid [mm³].
_LEAST_VOID_MM3 = 1e-3


@dataclass(frozen=True)
class Voids:
    """Empty space inside a print that cannot be seen from outside.

    Attributes:
        count: Number of separate voids.
        volume_mm3: Volume of all of them.
        largest_mm3: Volume of the largest.
    """

    count: int
    volume_mm3: float
    largest_mm3: float


def fill_voids(field: Field, grid: Grid, plate_z_mm: float) -> Voids:
    """Fill what cannot be seen from outside, in place.

    Seen is the empty space that a ball of `PROBE_MM` can reach from the grid's sides or
    top without entering material or the plate, and `DEPTH_MM` around it.

    Args:
        field: Signed field of the print; changed.
        grid: Its grid.
        plate_z_mm: Height of the plate [mm]; everything below it counts as solid.

    Returns:
        What was filled.
    """
    first = int(np.ceil((plate_z_mm - grid.origin[2]) / grid.voxel_mm))
    above = field[min(max(first, 0), grid.shape[0] - 1) :]
    seen = np.zeros(above.shape, np.uint8)
    probe = max(int(PROBE_MM / grid.value_mm), 1)
    rows, runs = kernels.find_runs(above, probe, seen, False)
    parents = kernels.join_runs(rows, runs, above.shape[0], above.shape[1])
    kernels.mark_outside(rows, runs, parents, seen)
    kernels.spread(above, seen, min(int(np.ceil(DEPTH_MM / grid.voxel_mm)), 250))
    rows, runs = kernels.find_runs(above, 0, seen, True)
    parents = kernels.join_runs(rows, runs, above.shape[0], above.shape[1])
    volumes = kernels.fill_unseen(above, rows, runs, parents, float(STEPS)) * grid.voxel_mm**3
    volumes = volumes[volumes > _LEAST_VOID_MM3]
    largest = float(volumes.max()) if len(volumes) else 0.0
    return Voids(len(volumes), float(volumes.sum()), largest)
