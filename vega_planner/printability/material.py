# SPDX-License-Identifier: Apache-2.0
"""What is there: the part's material by who prints it, and distance fields of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vega_planner.datatypes import Floats, TriangleGeometry
from vega_planner.parallel import map_threads
from vega_planner.printability import grid_kernels as kernels
from vega_planner.printability.tool_kernels import CLEAR, tool_clearance
from vega_planner.printability.tool_shape import STEP_MM, ToolShape

#: Voxels of a stage's grid; a distance field of so many takes about 10 ms.
VOXELS = 150_000

#: Offset of the grid's origin, so that no column runs along the edges of round numbers.
_JITTER = (0.0123, 0.0247, 0.0371)


@dataclass(frozen=True, eq=False)
class DistanceField:
    """Distances to something solid, sampled on a grid.

    Attributes:
        values: Distances from the solid's surface [mm], about zero inside, float32.
        origin: Position of sample 0 [mm].
        spacing: Spacing of the samples [mm].
    """

    values: np.ndarray
    origin: Floats
    spacing: float

    @classmethod
    def of(cls, solid: np.ndarray, origin: Floats, spacing: float) -> DistanceField:
        """Compute the field of the marked voxels of a grid."""
        values = np.empty(solid.shape, np.float32)
        kernels.distance_to(solid, spacing, values)
        values -= np.float32(0.5 * spacing)
        return cls(values, origin, spacing)

    def distance(self, points: Floats) -> Floats:
        """Look up the distance at the sample nearest to each point [mm], shape (n,).

        Beyond the grid it is a lower bound.
        """
        at = (points - self.origin) / self.spacing
        index = np.clip(np.rint(at), 0, np.array(self.values.shape) - 1).astype(np.int64)
        beyond = self.spacing * np.linalg.norm(at - np.clip(at, index - 0.5, index + 0.5), axis=1)
        value = self.values[tuple(index.T)]
        return np.where(beyond > 0, np.hypot(np.maximum(value, 0.0), beyond), value)

    def clearance(
        self,
        tool: ToolShape,
        tips: Floats,
        axes: Floats,
        enough_mm: float = 1.0,
        give_up_mm: float = -np.inf,
    ) -> Floats:
        """Measure how far a tool stays clear of the solid.

        Args:
            tool: The tool; what is before its `start_mm` does not count.
            tips: Tips [mm], shape (n, 3).
            axes: Unit vectors from the tip back along the tool, shape (n, 3).
            enough_mm: Clearance beyond which the exact value does not matter.
            give_up_mm: Clearance below which the exact value does not matter.

        Returns:
            Clearances [mm], negative where the tool is inside, shape (n,).
        """
        out = np.full(len(tips), CLEAR)
        if self is EMPTY or not len(tips):
            return out
        tool_clearance(
            np.ascontiguousarray(tips), np.ascontiguousarray(axes), self.values, self.origin,
            1.0 / self.spacing, tool.start_mm, STEP_MM, tool.inscribed,
            tool.reach, tool.rim_at, tool.rim_radius, enough_mm, give_up_mm,
            out,
        )  # fmt: skip
        return out


#: The field of nothing at all.
EMPTY = DistanceField(np.full((2, 2, 2), CLEAR, np.float32), np.zeros(3), 1.0)


def grid_for(low: Floats, high: Floats, finest_mm: float) -> tuple[Floats, float, tuple[int, ...]]:
    """Choose a grid over a box.

    Args:
        low: Lowest corner [mm].
        high: Highest corner [mm].
        finest_mm: Smallest spacing; it grows where the box would take too many voxels.

    Returns:
        Origin [mm], spacing [mm] and shape.
    """
    size = np.maximum(high - low, finest_mm)
    spacing = max(finest_mm, float(np.prod(size) / VOXELS) ** (1 / 3))
    origin = low - spacing * (1.5 + np.array(_JITTER))
    shape = tuple(int(n) for n in np.ceil((high - origin) / spacing + 1.5) + 1)
    return origin, spacing, shape


def mesh_field(mesh: TriangleGeometry, finest_mm: float) -> DistanceField:
    """Compute the distance field of a closed mesh."""
    origin, spacing, shape = grid_for(mesh.vertices.min(0), mesh.vertices.max(0), finest_mm)
    solid = np.zeros(shape, np.bool_)
    kernels.fill_mesh(mesh.vertices, mesh.faces, origin, spacing, solid)
    return DistanceField.of(solid, origin, spacing)


class Material:
    """The part's material on a grid: each voxel belongs to the nearest of some surfaces.

    Args:
        part: Closed mesh the material fills.
        surfaces: Middle surfaces of what is printed; voxels belong to their faces.
        finest_mm: Smallest spacing of the grid.
    """

    def __init__(
        self, part: TriangleGeometry, surfaces: Sequence[TriangleGeometry], finest_mm: float
    ) -> None:
        low, high = part.vertices.min(0), part.vertices.max(0)
        self.origin, self.spacing, shape = grid_for(low, high, finest_mm)
        self.solid = np.zeros(shape, np.bool_)
        kernels.fill_mesh(part.vertices, part.faces, self.origin, self.spacing, self.solid)
        self.face = np.full(shape, -1, np.int32)
        best = np.full(shape, 9.0, np.float32)
        counts = [len(surface.faces) for surface in surfaces]
        self.first = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        for surface, first in zip(surfaces, self.first):
            kernels.stamp_faces(
                surface.vertices, surface.faces, self.origin, self.spacing, first, self.face, best
            )
        kernels.nearest_label(self.face)
        self._fields: dict[bytes, DistanceField] = {}
        self._whole: DistanceField | None = None

    def prepare(self, stages: Sequence[np.ndarray]) -> None:
        """Compute the fields of several choices of surfaces on all cores."""
        map_threads(self.field_of, {np.packbits(c).tobytes(): c for c in stages}.values())

    def holds(self, points: Floats) -> np.ndarray:
        """Tell which points are in the part, give or take half a voxel, shape (n,)."""
        if self._whole is None:
            self._whole = DistanceField.of(self.solid, self.origin, self.spacing)
        return self._whole.distance(points) <= 0.5 * self.spacing

    def face_at(self, points: Floats) -> np.ndarray:
        """Name the face whose material is at points, or nearest to them, shape (n,)."""
        index = np.rint((points - self.origin) / self.spacing).astype(np.int64)
        i, j, k = np.clip(index, 0, np.array(self.face.shape) - 1).T
        return self.face[i, j, k]

    def forget(self, stages: Sequence[np.ndarray]) -> None:
        """Drop the fields of choices that are not needed any more."""
        for chosen in stages:
            self._fields.pop(np.packbits(chosen).tobytes(), None)

    def field_of_faces(self, chosen: np.ndarray) -> DistanceField:
        """Compute the distance field of the material that belongs to some faces.

        Args:
            chosen: True for the faces, numbered through all surfaces in order.
        """
        marked = np.empty(self.solid.shape, np.bool_)
        if not kernels.select(self.face, self.solid, chosen, marked):
            return EMPTY
        return DistanceField.of(marked, self.origin, self.spacing)

    def field_of(self, chosen: np.ndarray) -> DistanceField:
        """Compute the distance field of the material of some surfaces.

        Args:
            chosen: True for the surfaces, in the order given.
        """
        key = np.packbits(chosen).tobytes()
        if key not in self._fields:
            faces = np.repeat(chosen, np.diff(self.first))
            self._fields[key] = self.field_of_faces(faces)
        return self._fields[key]
