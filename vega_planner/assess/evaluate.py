# SPDX-License-Identifier: Apache-2.0
"""Evaluating a scanned print: register it, cut away what is not print, measure."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from vega_planner.assess.closest import SurfaceDistance
from vega_planner.assess.fidelity import (
    TARGET_SAMPLES,
    Deviation,
    Fidelity,
    measure_deviation,
    measure_points,
    sample_surface,
    surface_figures,
)
from vega_planner.assess.fidelity import vertex_areas as areas_of
from vega_planner.assess.field import MOST_NODES, Grid, mesh_field
from vega_planner.assess.plate_removal import belongs, without_plate
from vega_planner.assess.registration import (
    CLUTTER_RATIO,
    Registration,
    pose_from_markers,
    register,
)
from vega_planner.datatypes import Bools, Floats, Ints, Part, TriangleGeometry, face_cross
from vega_planner.errors import BadMesh
from vega_planner.progress import Progress, Report, silent, within


@dataclass(frozen=True, eq=False)
class Scan(TriangleGeometry):
    """A scanned surface, closed or not.

    Attributes:
        vertices: Points [mm], shape (n, 3).
        faces: Vertex indices, shape (m, 3).
    """

    vertices: Floats
    faces: Ints

    def __post_init__(self) -> None:
        self._freeze_mesh()

    def part_of(self, keep: np.ndarray) -> Scan:
        """Keep some of the faces, and the vertices they use."""
        used, flat = np.unique(self.faces[keep], return_inverse=True)
        return Scan(self.vertices[used], flat.reshape(-1, 3))

    @property
    def closed(self) -> bool:
        """Whether every edge joins two faces that run through it in opposite directions."""
        starts, ends = self.faces.ravel(), np.roll(self.faces, -1, axis=1).ravel()
        there = np.sort(starts * len(self.vertices) + ends)
        back = np.sort(ends * len(self.vertices) + starts)
        return bool(len(there) and (there == back).all() and (np.diff(there) > 0).all())


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A measured print.

    Attributes:
        fidelity: The measures of the paper over what was scanned.
        free: The same over what is not restrained.
        registration: Where the scan was found to lie.
        scan: The print's surface in the target's frame, without plate and clutter.
        deviation: e2 at its vertices.
        coverage_ratio: Share of the target's surface that the scan covers.
        closed: Whether the scan is a closed surface, so that e1 is that of solids;
            otherwise it is the volume between the scanned surface and the target.
    """

    fidelity: Fidelity
    free: Fidelity
    registration: Registration
    scan: Scan
    deviation: Deviation
    coverage_ratio: float
    closed: bool

    def as_dict(self) -> dict[str, Any]:
        """The figures of `metrics.json`."""
        where = self.registration
        return {
            **self.fidelity.as_dict(),
            "free": self.free.as_dict(),
            "coverage_ratio": round(self.coverage_ratio, 4),
            "closed": self.closed,
            "e2_signed_mean_mm": round(
                float(np.average(self.deviation.signed, weights=self.deviation.areas)), 6
            ),
            "registration": {
                "certainty": where.certainty,
                "ambiguous": where.ambiguous,
                "rms_mm": round(where.rms_mm, 6),
                "sigma_mm": round(where.sigma_mm, 6),
                "sigma_deg": round(where.sigma_deg, 6),
                "fit_ratio": round(where.fit_ratio, 4),
                "used_ratio": round(where.used_ratio, 4),
                "runner_up_ratio": round(where.runner_up_ratio, 4),
                "T_target_scan": where.T_target_scan.round(9).tolist(),
            },
        }


def measure(
    scan: Scan,
    target: Part,
    *,
    markers: tuple[Floats, Floats] | None = None,
    seed: int = 0,
    report: Report = silent,
) -> Evaluation:
    """Register a scan and measure it.

    Args:
        scan: Scanned surface [mm], in any pose; may hold plate and clutter.
        target: What was to be printed.
        markers: Points of the scan and where they belong on the target, both (n, 3),
            n >= 3, in place of the search for the pose.
        seed: Seed of everything random.
        report: Told how far it is; may raise `Cancelled`.

    Raises:
        NotRegistered: If no pose fits well enough.
    """
    surface = SurfaceDistance(target.vertices, target.faces)
    size = float(np.linalg.norm(np.ptp(target.bounds, axis=0)))
    scan = scan.part_of(without_plate(scan, size, seed))
    start = None if markers is None else pose_from_markers(*markers)
    where = register(
        scan,
        target,
        surface=surface,
        start=start,
        seed=seed,
        report=within(report, "registration", 0.05, 0.7),
    )
    moved = Scan(where.apply(scan.vertices), scan.faces)
    limit = CLUTTER_RATIO * size
    keep = belongs(
        moved,
        surface.query(moved.vertices),
        limit,
        float(target.bounds[0, 2]),
        where.rms_mm,
    )
    whole = bool(keep.all())
    moved = moved.part_of(keep)
    report(Progress("measures", 0.75))
    deviation = measure_deviation(moved.vertices, moved.faces, surface, target.restrained)
    spread, _ = sample_surface(moved, TARGET_SAMPLES)
    sampled = measure_points(spread, surface, target.restrained)
    back, covered, loose = _back(moved, target, limit, where.rms_mm)
    report(Progress("measures", 0.85))
    closed = whole and moved.closed
    volumes = _solid_difference(moved, target, surface) if closed else _between(moved, deviation)
    free_volumes = volumes
    if target.restrained.any():
        free_volumes = _between(moved, deviation, only_free=True)
    return Evaluation(
        fidelity=_fidelity(volumes, target, surface_figures(sampled, back[covered])),
        free=_fidelity(free_volumes, target, surface_figures(sampled, back[loose], sampled.free)),
        registration=where,
        scan=moved,
        deviation=deviation,
        coverage_ratio=float(covered.mean()),
        closed=closed,
    )


def _back(scan: Scan, target: Part, limit: float, rms: float) -> tuple[Floats, Bools, Bools]:
    """Distances from samples of the target to the scan, which of them it covers, and
    which of those are not restrained.

    Where the closest point of the scan faces another way, or lies on the scan's border
    and is not near, the scan has a hole: nothing is known there.
    """
    samples, faces = sample_surface(target, TARGET_SAMPLES)
    surface = SurfaceDistance(scan.vertices, scan.faces)
    found = surface.query(samples, signed=False)
    border = np.bincount(surface.edge_ids.ravel())[surface.edge_ids] == 1
    on_border = np.zeros(len(scan.vertices), bool)
    for k in range(3):
        on_border[scan.faces[border[:, k]][:, [k, (k + 1) % 3]]] = True
    flags = np.column_stack([np.zeros(len(border), bool), border, on_border[scan.faces]])
    at_border = flags[found.faces, found.features]
    alike = np.einsum("ij,ij->i", target.face_normals[faces], scan.face_normals[found.faces]) > 0
    covered = alike & (found.signed < limit)
    covered &= ~(at_border & (found.signed > max(3 * rms, 0.1)))
    return found.signed, covered, covered & ~target.restrained[faces]


def _fidelity(
    volumes: tuple[float, float], target: Part, figures: tuple[float, float, float, float]
) -> Fidelity:
    under, over = (100 * volume / target.volume for volume in volumes)
    return Fidelity(under + over, under, over, *figures)


def _solid_difference(scan: Scan, target: Part, surface: SurfaceDistance) -> tuple[float, float]:
    """Under- and overshoot between two closed meshes [mm³], on a grid."""
    from vega_planner.assess.sample_kernels import SAMPLES
    from vega_planner.assess.volume_kernels import compare_fields

    low = np.minimum(scan.vertices.min(0), target.bounds[0])
    high = np.maximum(scan.vertices.max(0), target.bounds[1])
    voxel = float(max((high - low).max() / 200, np.cbrt(np.prod(high - low) / (0.1 * MOST_NODES))))
    grid = Grid.around(low, high, voxel, 3 * voxel)
    printed = mesh_field(SurfaceDistance(scan.vertices, scan.faces), grid)
    nowhere, nothing = np.zeros(0, np.int64), np.zeros((0, SAMPLES), np.int16)
    _, parts, _ = compare_fields(
        printed, mesh_field(surface, grid), 0, grid.shape[0] - 1, nowhere, nothing
    )
    under, over = parts.sum(0) * voxel**3
    return float(under), float(over)


def _between(scan: Scan, deviation: Deviation, only_free: bool = False) -> tuple[float, float]:
    """Under- and overshoot between an open scan and the target [mm³].

    Each face and the closest points of its corners bound a prism. As the face moves
    from the target to its place, its area vector changes with the square of the way, so
    Simpson's rule gives the prism's volume.
    """
    feet, faces = deviation.feet, scan.faces
    way = scan.vertices - feet
    mean_way = way[faces].mean(1)
    volumes = np.zeros(len(faces))
    for share, weight in ((0.0, 1 / 6), (0.5, 4 / 6), (1.0, 1 / 6)):
        vectors = 0.5 * face_cross(feet + share * way, faces)
        volumes += weight * np.einsum("ij,ij->i", vectors, mean_way)
    signed = deviation.signed[faces]
    total = np.abs(signed).sum(1)
    out_share = np.maximum(signed, 0).sum(1) / np.where(total > 0, total, 1.0)
    mixed = (signed.max(1) > 0) & (signed.min(1) < 0)
    flat = 0.5 * np.linalg.norm(face_cross(scan.vertices, faces), axis=1) * total / 3
    size = np.where(mixed, flat, np.abs(volumes))
    # A prism whose sign is not that of its side takes back what another counted twice.
    side = np.where(mixed, 1.0, np.sign(volumes) * np.sign(signed.sum(1)))
    if only_free:
        size = size * deviation.free[faces].mean(1)
    under = float((side * size * (1 - out_share)).sum())
    over = float((side * size * out_share).sum())
    return max(under, 0.0), max(over, 0.0)


def evaluate(
    scan: str | Path | Scan,
    target: str | Path | Part,
    out: str | Path,
    *,
    markers: tuple[Floats, Floats] | None = None,
    seed: int = 0,
    report: Report = silent,
) -> dict[str, Any]:
    """Evaluate a scan; writes `metrics.json`, `report.html` and `aligned.ply`.

    Args:
        scan: Scanned mesh, or its file.
        target: Part, its mesh file, or a result folder of `vega plan`.
        out: Folder to write.
        markers: As for `measure`.
        seed: Seed of everything random.
        report: Told how far it is; may raise `Cancelled`.

    Returns:
        The figures of `metrics.json`.

    Raises:
        BadMesh: If a file cannot be read, or the scan has no faces.
        NotRegistered: If the scan cannot be laid onto the target.
        OutputError: If the folder cannot be written.
    """
    from vega_planner.assess.fidelity_page import evaluation_page
    from vega_planner.results.folder import check_output_folder, write_folder
    from vega_planner.results.ply import mesh_ply

    check_output_folder(out)
    part = _target(target)
    result = measure(_scan(scan), part, markers=markers, seed=seed, report=report)
    figures = result.as_dict()
    write_folder(
        out,
        {
            "metrics.json": (json.dumps(figures, indent=2) + "\n").encode(),
            "aligned.ply": mesh_ply(
                result.scan.vertices, result.scan.faces, {"deviation": result.deviation.signed}
            ),
            "report.html": evaluation_page(part, result),
        },
    )
    report(Progress("report", 1.0))
    return figures


def _scan(source: str | Path | Scan) -> Scan:
    if isinstance(source, Scan):
        return source
    from vega_planner.part.readers import read_mesh

    raw = read_mesh(Path(source))
    if len(raw.faces) == 0:
        raise BadMesh(f"scan {source} has no faces; a surface mesh is needed, not a point cloud")
    vertices, flat = np.unique(raw.vertices[raw.faces.ravel()], axis=0, return_inverse=True)
    faces = flat.reshape(-1, 3)
    solid = np.linalg.norm(face_cross(vertices, faces), axis=1) > 0
    scan = Scan(vertices, faces[solid])
    if not np.isfinite(areas_of(scan.vertices, scan.faces)).all() or not solid.any():
        raise BadMesh(f"scan {source} has no surface")
    return scan


def _target(source: str | Path | Part) -> Part:
    if isinstance(source, Part):
        return source
    if Path(source).is_dir():
        from vega_planner.assess.virtual_print import read_target

        return replace(read_target(source), source=str(source))
    from vega_planner.part import load_part

    return load_part(source)
