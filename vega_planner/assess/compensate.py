# SPDX-License-Identifier: Apache-2.0
"""Compensation: moving the target against a deviation that was measured."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from vega_planner.assess.closest import SurfaceDistance
from vega_planner.datatypes import Bools, Floats, Ints, Part
from vega_planner.errors import InvalidInput
from vega_planner.results.ply import read_mesh_ply

#: Deviations are averaged over this distance, above the size of layers and beads [mm].
SMOOTH_MM = 2.0
#: The target moves at most this far [mm].
MOST_MM = 1.0
#: Longer edges of the target are cut, so that it can bend [mm].
_EDGE_MM = 2.5
_MOST_FACES = 120_000
#: Measured points used; more say nothing new at the distance they are averaged over.
_MOST_POINTS = 40_000


def compensated_part(part: Part, report_dir: str | Path) -> Part:
    """Move a target against the deviation that was measured on its print.

    Each vertex goes against its normal by the deviation, averaged over `SMOOTH_MM` and
    bounded by `MOST_MM`. Where nothing was measured nothing moves, and restrained faces
    stay in their surface.

    Args:
        part: The target, as it was evaluated.
        report_dir: Folder of `vega evaluate` (`aligned.ply`) or a simulated result
            folder (`printed.ply`).

    Returns:
        The moved target; its warnings say how far it moved.

    Raises:
        InvalidInput: If the folder holds no measured deviation.
    """
    points, signed = _measured(Path(report_dir))
    vertices, faces, origin = _refined(part.vertices, part.faces)
    fine = Part(part.name, vertices, faces, part.restrained[origin], part.brr)
    surface = SurfaceDistance(part.vertices, part.faces)
    found = surface.query(points)
    near = np.abs(signed) < 5 * MOST_MM
    near &= np.arange(len(signed)) % (1 + len(signed) // _MOST_POINTS) == 0
    normals = surface.normals[found.faces, 0]
    shift = _averaged(
        fine.vertices, fine.vertex_normals, found.feet[near], normals[near], signed[near]
    )
    shift = np.clip(shift, -MOST_MM, MOST_MM)
    motion = -shift[:, None] * fine.vertex_normals
    motion = _kept_in_restraint(motion, fine)
    moved = vertices + motion
    moved[:, 2] = np.maximum(moved[:, 2], 0.0)
    far = float(np.linalg.norm(motion, axis=1).max())
    return replace(
        fine,
        vertices=moved,
        source=part.source,
        warnings=(*part.warnings, f"compensated: the target moved by up to {far:.3f} mm"),
    )


def _measured(folder: Path) -> tuple[Floats, Floats]:
    for name in ("aligned.ply", "printed.ply"):
        if (folder / name).exists():
            vertices, _, extra = read_mesh_ply(folder / name)
            if "deviation" in extra:
                return vertices, extra["deviation"]
    raise InvalidInput(
        f"{folder} holds no measured deviation; expected a folder of 'vega evaluate' or a "
        "result folder after 'vega simulate'"
    )


def _refined(vertices: Floats, faces: Ints) -> tuple[Floats, Ints, Ints]:
    """Cut every face into four until edges are short; returns the faces they came from."""
    origin = np.arange(len(faces))
    while 4 * len(faces) <= _MOST_FACES:
        corners = vertices[faces]
        longest = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max()
        if longest <= _EDGE_MM:
            break
        sides = np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1)
        keys = sides.min(-1) * len(vertices) + sides.max(-1)
        unique, middle = np.unique(keys, return_inverse=True)
        ends = np.column_stack(np.divmod(unique, len(vertices)))
        a, b, c = faces.T
        ab, bc, ca = (middle.reshape(-1, 3) + len(vertices)).T
        vertices = np.concatenate([vertices, vertices[ends].mean(1)])
        faces = np.concatenate(
            [np.column_stack(t) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
        )
        origin = np.tile(origin, 4)
    return vertices, faces, origin


def _averaged(
    places: Floats, directions: Floats, feet: Floats, normals: Floats, values: Floats
) -> Floats:
    """Average measured deviations round each place, of surfaces that face the same way."""
    from scipy.spatial import cKDTree

    tree = cKDTree(feet)
    distances, near = tree.query(places, k=min(256, len(feet)), distance_upper_bound=2 * SMOOTH_MM)
    distances, near = np.atleast_2d(distances), np.atleast_2d(near)
    there = np.isfinite(distances)
    near = np.where(there, near, 0)
    alike = np.einsum("ijk,ik->ij", normals[near], directions)
    weights = np.where(
        there, np.exp(-0.5 * (distances / (0.5 * SMOOTH_MM)) ** 2) * np.maximum(alike, 0) ** 2, 0.0
    )
    total = weights.sum(1)
    return np.where(total > 1e-9, (weights * values[near]).sum(1) / np.maximum(total, 1e-9), 0.0)


def _kept_in_restraint(motion: Floats, part: Part) -> Floats:
    """Take the motion square to the restrained faces away from their vertices."""
    if not part.restrained.any():
        return motion
    total = np.zeros_like(part.vertices)
    held: Bools = np.zeros(len(part.vertices), bool)
    for corner in range(3):
        chosen = part.faces[part.restrained, corner]
        np.add.at(total, chosen, part.face_normals[part.restrained])
        held[chosen] = True
    lengths = np.linalg.norm(total, axis=1, keepdims=True)
    normal = total / np.where(lengths > 0, lengths, 1.0)
    square = np.einsum("ij,ij->i", motion, normal)[:, None] * normal
    return np.where(held[:, None], motion - square, motion)
