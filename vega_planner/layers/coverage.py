# SPDX-License-Identifier: Apache-2.0
"""How much of a part its layers cover, and how much material is laid in excess."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from vega_planner.datatypes import Floats, Ints, Layer, Part
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
        nodes: The points in the part, as flat indices, shape (n,).
    """

    origin: Floats
    spacing: float
    shape: tuple[int, int, int]
    nodes: Ints

    def points(self, nodes: Ints) -> Floats:
        """Give the places of points [mm], shape (k, 3)."""
        steps = np.column_stack(np.unravel_index(nodes, self.shape))
        return np.asarray((self.origin + self.spacing * steps) @ AXES.T)

    def about(self, places: Floats, reach: float) -> Ints:
        """Choose the points that are within a distance of places, along each axis.

        Args:
            places: The places [mm], shape (k, 3).
            reach: The distance [mm].

        Returns:
            Those points, as flat indices.
        """
        middle = np.rint((places @ AXES - self.origin) / self.spacing).astype(np.int64)
        steps = range(-int(np.ceil(reach / self.spacing)), int(np.ceil(reach / self.spacing)) + 1)
        chosen = np.zeros(self.shape, bool)
        for step in product(steps, repeat=3):
            chosen[tuple(np.clip(middle + step, 0, np.array(self.shape) - 1).T)] = True
        return self.nodes[chosen.flat[self.nodes]]


@dataclass(frozen=True, eq=False)
class Coverage:
    """What sheets cover of a part.

    Attributes:
        uncovered: Volume inside no sheet's own thickness, over the part's volume.
        overfill: Material of all sheets, area times thickness, beyond the inside volume
            that they cover, over the part's volume.
        open_nodes: The samples that no sheet covers, shape (k,).
    """

    uncovered: float
    overfill: float
    open_nodes: Ints


def spread_samples(part: Part, count: int = SAMPLES) -> Samples:
    """Spread about so many points over a part, to be asked which layers cover them."""
    spacing = (part.volume / count) ** (1 / 3)
    turned = np.ascontiguousarray(part.vertices @ AXES)
    low, high = (np.array([end(x) for x in turned.T]) for end in (np.min, np.max))
    across, along, up = (int(n) for n in np.ceil((high - low) / spacing) + 2)
    shape = (across, along, up)
    origin = low - 0.37 * spacing
    state = inside_states(turned, part.faces, origin, spacing, shape)
    return Samples(origin, spacing, shape, np.flatnonzero(state == INSIDE))


def measure_coverage(
    part: Part, samples: Samples, sheets: tuple[Layer, ...], before: Coverage | None = None
) -> Coverage:
    """Compare what the sheets cover with the part.

    A sheet covers what lies within half its local thickness.

    Args:
        part: The part.
        samples: Points of the part.
        sheets: All layers, cores included.
        before: Coverage of sheets of the same shape that were nowhere thicker, if known:
            only what they left open is looked at.

    Returns:
        What is covered.
    """
    nodes = samples.nodes if before is None else before.open_nodes
    row = np.full(samples.shape, -1, np.int32)
    row.flat[nodes] = np.arange(len(nodes), dtype=np.int32)
    empty = np.full([n + 1 for n in samples.shape], kernels.EMPTY, np.uint8)
    kernels.measure_empty(row, empty)
    covered = np.zeros(len(nodes), np.uint8)

    def cover(sheet: Layer) -> float:
        material: float = kernels.cover(
            sheet.vertices, AXES, sheet.faces, sheet.thickness, samples.origin, samples.spacing,
            row, empty, covered,
        )  # fmt: skip
        return material

    # Threads only ever set marks, so their order does not matter.
    material = sum(map_threads(cover, [sheet for sheet in sheets if len(sheet.faces)]))
    open_nodes = nodes[covered == 0]
    count = len(samples.nodes)
    share = (count - len(open_nodes)) / count if count else 0.0
    overfill = max(0.0, material / part.volume - share)
    return Coverage(1.0 - share, overfill, open_nodes)
