# SPDX-License-Identifier: Apache-2.0
"""Signed fields on a regular grid, in fixed point."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from vega_planner.assess import bead_kernels as kernels
from vega_planner.assess import sample_kernels, volume_kernels
from vega_planner.assess.beads import BeadRows
from vega_planner.assess.closest import SurfaceDistance
from vega_planner.datatypes import Floats
from vega_planner.errors import InvalidInput
from vega_planner.parallel import cores, map_threads

Field = NDArray[np.int16]

#: Distance outside a bead up to which its field is drawn, in voxels.
BAND_VOXELS = 2.5
#: The same for meshes: the corners of a cell that the surface passes.
MESH_BAND_VOXELS = 1.8
#: Largest grid: int16 and two byte fields of this many nodes fill 2 GB of memory.
MOST_NODES = 500_000_000
#: Shift of the nodes against whole multiples of the voxel size, in voxels. Small, so
#: that a plane of nodes runs through the thin wedges between flat layers, whose heights
#: are usually such multiples; not zero, since a field that is exactly zero at a node
#: does not tell the sides apart.
_OFFSET = 0.04
#: Beads are followed within this share of a voxel.
_THIN_RATIO = 0.03


@dataclass(frozen=True, eq=False)
class Grid:
    """A regular grid of nodes.

    Attributes:
        origin: Place of node (0, 0, 0) [mm], shape (3,).
        voxel_mm: Distance between nodes.
        shape: Number of nodes along z, y and x.
    """

    origin: Floats
    voxel_mm: float
    shape: tuple[int, int, int]

    @staticmethod
    def around(low: Floats, high: Floats, voxel_mm: float, margin_mm: float) -> Grid:
        """Make the grid that covers a box with a margin.

        Raises:
            InvalidInput: If it would have too many nodes; names the least voxel size.
        """
        if not voxel_mm > 0:
            raise InvalidInput(f"voxel size {voxel_mm:g} mm; must be above 0")
        first = np.floor((low - margin_mm) / voxel_mm) - _OFFSET
        counts = np.ceil((high + margin_mm) / voxel_mm - first).astype(np.int64) + 1
        nodes = float(np.prod(counts.astype(np.float64)))
        if nodes > MOST_NODES:
            least = voxel_mm * (nodes / MOST_NODES) ** (1 / 3)
            raise InvalidInput(
                f"voxel size {voxel_mm:g} mm needs {nodes:.3g} nodes for "
                f"{np.round(high - low, 1).tolist()} mm; least possible: {least:.2g} mm"
            )
        return Grid(first * voxel_mm, voxel_mm, (int(counts[2]), int(counts[1]), int(counts[0])))

    @property
    def value_mm(self) -> float:
        """Length of one step of a field's fixed-point values [mm]."""
        return self.voxel_mm / kernels.STEPS

    def slabs(self) -> list[slice]:
        """Cut the planes into slabs, several for each core."""
        count = max(1, min(self.shape[0] // 8, 6 * cores()))
        edges = np.linspace(0, self.shape[0], count + 1).astype(int)
        return [slice(int(a), int(b)) for a, b in pairwise(edges)]


def bead_field(beads: BeadRows, grid: Grid, band_mm: float = 0.0) -> Field:
    """Compute the signed distance to the union of beads.

    Outside the beads it is exact as far as `BAND_VOXELS`, and the largest value beyond;
    inside it is the depth in the deepest single bead.

    Args:
        beads: What was deposited.
        grid: Where to compute it.
        band_mm: Distance up to which it must be exact, where that is more.

    Returns:
        Distances in steps of `grid.value_mm`, shape `grid.shape`.
    """
    segments = bead_segments(beads, grid)
    starts, ends, up0, up1, section = segments
    band = max(BAND_VOXELS * grid.voxel_mm, band_mm)
    reach = 0.5 * (section.max(1) if len(section) else np.zeros(0)) + band
    lowest = np.minimum(starts[:, 2], ends[:, 2]) - reach
    highest = np.maximum(starts[:, 2], ends[:, 2]) + reach
    field = np.empty(grid.shape, np.int16)
    origin = grid.origin.astype(np.float32)

    def draw(slab: slice) -> None:
        field[slab] = kernels.LIMIT
        bottom = grid.origin[2] + slab.start * grid.voxel_mm
        top = grid.origin[2] + (slab.stop - 1) * grid.voxel_mm
        chosen = np.flatnonzero((highest >= bottom) & (lowest <= top))
        kernels.draw_beads(
            field[slab],
            slab.start,
            origin,
            grid.voxel_mm,
            chosen,
            starts,
            ends,
            up0,
            up1,
            section,
            band,
        )

    map_threads(draw, grid.slabs())
    return field


def mesh_field(surface: SurfaceDistance, grid: Grid) -> Field:
    """Compute the signed distance to a closed mesh, exact within `MESH_BAND_VOXELS`."""
    field = np.empty(grid.shape, np.int16)
    normals = surface.normals

    def draw(slab: slice) -> None:
        volume_kernels.draw_mesh(
            field[slab],
            slab.start,
            grid.origin,
            grid.voxel_mm,
            MESH_BAND_VOXELS * grid.voxel_mm,
            surface.corners,
            surface.order,
            surface.boxes,
            surface.first_leaf,
            normals,
        )

    map_threads(draw, grid.slabs())
    return field


def surface_samples(
    segments: tuple[NDArray, ...], printed: Field, grid: Grid, slab: slice, plate_z_mm: float
) -> tuple[NDArray[np.int64], NDArray[np.int16]]:
    """Measure the exact distance to the beads in the cells of a slab on the seen surface.

    Between nodes the bottom of a groove is sharp and the top of a bead round: no
    interpolation of the nodes' values tells how much of such a cell is filled.

    Args:
        segments: What `bead_segments` returns.
        printed: Field of the print, its voids filled.
        grid: Its grid.
        slab: Planes of cells to look at.
        plate_z_mm: Height of the plate, on which nothing is seen.

    Returns:
        Index of the cells' first nodes, ascending, (n,), and the distances at the samples
        inside them and at their corners in steps of `grid.value_mm`, (n, samples).
    """
    floor = max(int(np.ceil((plate_z_mm - grid.origin[2]) / grid.voxel_mm)), 0)
    cells = sample_kernels.surface_cells(printed, slab.start, slab.stop, floor)
    samples = np.full((len(cells), sample_kernels.SAMPLES), kernels.LIMIT, np.int16)
    starts, ends, _, _, section = segments
    reach = 0.5 * (section.max(1) if len(section) else np.zeros(0)) + grid.voxel_mm
    bottom = grid.origin[2] + slab.start * grid.voxel_mm
    top = grid.origin[2] + slab.stop * grid.voxel_mm
    chosen = np.flatnonzero(
        (np.maximum(starts[:, 2], ends[:, 2]) + reach >= bottom)
        & (np.minimum(starts[:, 2], ends[:, 2]) - reach <= top)
    )
    shape = np.array(grid.shape, np.int64)
    sample_kernels.sample_beads(
        cells, shape, grid.origin, grid.voxel_mm, chosen, *segments, samples
    )
    return cells, samples


def cut_below(field: Field, grid: Grid, plate_z_mm: float) -> None:
    """Remove what lies below a plate, in place.

    Between beads the depth inside their union is small, though the outer surface is far:
    next to the plate such nodes would bend the cut. So nodes in the first plane above
    the plate that have no empty neighbour count as deep, and that plane is carried on
    below the plate before the cut.
    """
    heights = grid.origin[2] + grid.voxel_mm * np.arange(grid.shape[0])
    steps = np.clip((plate_z_mm - heights) / grid.value_mm, -kernels.LIMIT, kernels.LIMIT)
    first = int(np.searchsorted(heights, plate_z_mm))
    if 0 < first < grid.shape[0] - 1:
        empty = (field[first] >= 0) | (field[first + 1] >= 0)
        beside = empty.copy()
        beside[:, 1:] |= empty[:, :-1]
        beside[:, :-1] |= empty[:, 1:]
        near = beside.copy()
        near[1:] |= beside[:-1]
        near[:-1] |= beside[1:]
        field[first][~near] = -kernels.LIMIT
        field[:first] = field[first]
    for plane, value in zip(field, steps.astype(np.int16)):
        if value > -kernels.LIMIT:
            np.maximum(plane, value, out=plane)


def bead_segments(beads: BeadRows, grid: Grid) -> tuple[NDArray, ...]:
    """Lay out the beads as straight segments, with section directions square to them.

    Args:
        beads: What was deposited.
        grid: Its resolution says how closely the beads are followed.

    Returns:
        Start points, end points, height directions at both, each (s, 3); width and height
        at the start and at the end, (s, 4); all float32.
    """
    tolerance = _THIN_RATIO * grid.voxel_mm
    joined = beads.joined
    keep = np.zeros(len(beads.points), np.bool_)
    kernels.thin_rows(beads.points, beads.axes, beads.width, beads.height, joined, tolerance, keep)
    rows = np.flatnonzero(keep)
    here, there = rows[:-1], rows[1:]
    real = joined[here]
    here, there = here[real], there[real]
    starts, ends = beads.points[here], beads.points[there]
    along = ends - starts
    lengths = np.linalg.norm(along, axis=1, keepdims=True)
    along = along / np.where(lengths > 0, lengths, 1.0)
    section = np.column_stack(
        [beads.width[here], beads.height[here], beads.width[there], beads.height[there]]
    )
    arrays = (
        starts,
        ends,
        _square_to(along, beads.axes[here]),
        _square_to(along, beads.axes[there]),
        section,
    )
    return tuple(np.ascontiguousarray(array, np.float32) for array in arrays)


def _square_to(along: Floats, axes: Floats) -> Floats:
    """Turn axes square to the directions of travel, in the plane of the two."""
    square = axes - np.einsum("ij,ij->i", axes, along)[:, None] * along
    lengths = np.linalg.norm(square, axis=1, keepdims=True)
    # An axis along the travel has no section direction of its own: any will do.
    spare = np.cross(along, np.roll(along, 1, axis=1) + np.array([0.3, 0.5, 0.7]))
    spare /= np.maximum(np.linalg.norm(spare, axis=1, keepdims=True), 1e-12)
    return np.where(lengths > 1e-6, square / np.maximum(lengths, 1e-6), spare)
