# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Compiled search for the nodes of a grid about which a level may be passed unseen."""

from __future__ import annotations

import numpy as np

from vega_planner.compiled import kernel
from vega_planner.layers.grid_kernels import INSIDE

#: What a node is marked with: it has not reached the level, or it alone has passed it.
BELOW, ALONE = 1, 2


@kernel
def mark_summits(state, d, level, h, ny, nz, first, last, t, least, marks):
    """Mark the inside nodes of planes first:last that are deeper than all nodes about them.

    Args:
        state: States of the nodes.
        d: Distances of the nodes [mm].
        level: Number of levels below each node.
        h: Grid spacing [mm].
        ny: Nodes along y.
        nz: Nodes along z.
        first: First plane.
        last: End of the planes.
        t: Distance between levels [mm].
        least: Height over its level from which a summit counts [mm].
        marks: Result, 0 at first: `BELOW` or `ALONE`.
    """
    near, far = np.sqrt(0.75) * h, np.sqrt(3.0) * h
    for i in range(first, last):
        for j in range(1, ny - 1):
            for k in range(1, nz - 1):
                n = (i * ny + j) * nz + k
                if state[n] != INSIDE:
                    continue
                here = np.float64(d[n])
                unseen = (level[n] + 0.5) * t + least - here < near
                if not unseen and (level[n] == 0 or here - (level[n] - 0.5) * t >= far):
                    continue
                highest, alone = True, level[n] > 0
                for a in range(-1, 2):
                    for b in range(-1, 2):
                        for c in range(-1, 2):
                            m = n + (a * ny + b) * nz + c
                            if m == n or state[m] != INSIDE:
                                continue
                            highest = highest and d[m] <= d[n]
                            alone = alone and level[m] < level[n]
                if highest and (level[n] - alone + 0.5) * t + least - here < near:
                    marks[n] = ALONE if alone else BELOW
