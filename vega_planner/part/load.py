# SPDX-License-Identifier: Apache-2.0
"""From a file or arrays to a part: read, scale, repair, place, restrain."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vega_planner.datatypes import Floats, Part, TriangleGeometry
from vega_planner.errors import BadMesh
from vega_planner.part.readers import RawMesh, read_mesh, source_path
from vega_planner.part.repair import make_solid
from vega_planner.part.restraint import choose_restraint
from vega_planner.part.unit import unit_scale
from vega_planner.progress import Progress, Report, silent
from vega_planner.settings import PartSettings

MeshArrays = tuple[ArrayLike, ArrayLike] | tuple[ArrayLike, ArrayLike, str]


class _Surface(TriangleGeometry):
    """A mesh on its way to become a part."""

    def __init__(self, vertices: Floats, faces: Any) -> None:
        self.vertices, self.faces = vertices, faces


def load_part(
    source: str | Path | MeshArrays, settings: PartSettings | None = None, report: Report = silent
) -> Part:
    """Make a printable part of a mesh.

    The part is watertight (each edge joins two faces that run through it in opposite
    directions), its normals look out and its volume is above zero. Its lowest point
    lies on z = 0 and the middle of its bounding box on the z axis; it is not turned.

    Args:
        source: Path or file:// URI of an STL, OBJ, PLY, OFF, 3MF or STEP file, or
            (vertices, faces) or (vertices, faces, name) as arrays.
        settings: Unit, restraint region and its angles.
        report: Receives progress; may raise `Cancelled`.

    Returns:
        The part in millimetres, with what was repaired or guessed in its warnings.

    Raises:
        BadMesh: If the mesh cannot be read, or not be repaired into a solid.
        BadRestraint: If the restraint region cannot be understood or selects nothing.
    """
    settings = settings or PartSettings()
    raw, origin = _read(source)
    report(Progress("part", 0.2))
    astray = np.flatnonzero(~np.isfinite(raw.vertices).all(axis=1))
    if len(astray):
        raise BadMesh(
            f"mesh '{raw.name}': {len(astray)} of {len(raw.vertices)} vertices are not finite "
            f"numbers, the first is vertex {astray[0]}"
        )
    used = raw.vertices[raw.faces.ravel()]
    extent = float(np.ptp(used, axis=0).max()) if len(used) else 0.0
    if not extent > 0:
        raise BadMesh(f"mesh '{raw.name}' has no extent: all its vertices are at one place")
    try:
        scale, remarks = unit_scale(settings.unit, raw.unit, extent)
        vertices, faces, repairs = make_solid(raw.vertices * scale, raw.faces, report)
    except BadMesh as error:
        raise BadMesh(f"mesh '{raw.name}': {error}") from error
    report(Progress("part", 0.8))
    surface = _Surface(placed(vertices), faces)
    restrained, reasons = choose_restraint(surface, settings.brr, settings)
    part = Part(
        name=raw.name,
        vertices=surface.vertices,
        faces=faces,
        restrained=restrained,
        brr=settings.brr or ("none",),
        warnings=(*remarks, *repairs, *reasons),
        source=origin,
    )
    report(Progress("part", 1.0))
    return part


def placed(vertices: Floats) -> Floats:
    """Shift points so that the lowest lies on z = 0 and their box is centred on z.

    Args:
        vertices: Points [mm], shape (n, 3).

    Returns:
        Shifted points; placing them again changes nothing.
    """
    low, high = vertices.min(0), vertices.max(0)
    anchor = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    # What is left after one shift is rounding; shifting by it would move the last bit.
    rounding = 1e-12 * (high - low).max()
    anchor[np.abs(anchor) <= rounding] = 0.0
    shifted = vertices - anchor
    shifted[shifted[:, 2] <= rounding, 2] = 0.0
    return shifted


def _read(source: str | Path | MeshArrays) -> tuple[RawMesh, str]:
    if isinstance(source, str | Path):
        return read_mesh(source_path(source)), str(source)
    if not isinstance(source, tuple | list) or len(source) not in (2, 3):
        raise BadMesh(
            f"mesh of type {type(source).__name__}; choices: a path, a file:// URI, "
            "(vertices, faces[, name])"
        )
    name = str(source[2]) if len(source) == 3 else "part"
    try:
        vertices = np.array(source[0], dtype=np.float64)
        faces = np.array(source[1])
    except (TypeError, ValueError) as error:
        raise BadMesh(f"mesh '{name}': vertices or faces are not arrays of numbers") from error
    for what, array in (("vertices", vertices), ("faces", faces)):
        if array.size == 0:
            raise BadMesh(f"mesh '{name}' has no {what}")
        if array.ndim != 2 or array.shape[1] != 3:
            raise BadMesh(f"mesh '{name}': {what} have shape {array.shape}; expected (any, 3)")
    if faces.dtype.kind not in "iu":
        raise BadMesh(f"mesh '{name}': faces are {faces.dtype}; expected whole numbers")
    faces = faces.astype(np.int64)
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise BadMesh(
            f"mesh '{name}': faces name vertex {faces.min() if faces.min() < 0 else faces.max()}; "
            f"there are {len(vertices)}"
        )
    return RawMesh(name, vertices, faces), ""
