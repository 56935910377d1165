# SPDX-License-Identifier: Apache-2.0
"""Virtual print: what a toolpath would leave on the plate, and how true it is."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vega_planner.assess import volume_kernels
from vega_planner.assess.beads import BeadRows, beads_of, read_beads
from vega_planner.assess.closest import SurfaceDistance
from vega_planner.assess.dispensing import PERFECT, Dispensing, dispensed
from vega_planner.assess.fidelity import (
    TARGET_SAMPLES,
    Deviation,
    Fidelity,
    measure_deviation,
    sample_surface,
    surface_figures,
)
from vega_planner.assess.field import (
    Field,
    Grid,
    bead_field,
    bead_segments,
    cut_below,
    mesh_field,
    surface_samples,
)
from vega_planner.assess.isosurface import extract_surface
from vega_planner.assess.scanner import IDEAL, Scanner, scanned
from vega_planner.assess.sight import PROBE_MM, Voids, fill_voids
from vega_planner.datatypes import Bools, Floats, Ints, Part, ToolpathSet, TriangleGeometry
from vega_planner.errors import InvalidInput
from vega_planner.parallel import map_threads
from vega_planner.printability.grid_kernels import fill_mesh
from vega_planner.progress import Progress, Report, silent

STAGE = "virtual print"


@dataclass(frozen=True, eq=False)
class VirtualPrint(TriangleGeometry):
    """A print that never was: its outer surface, and how true it is.

    Attributes:
        vertices: Points of the outer surface [mm], shape (n, 3).
        faces: Vertex indices, normals outward, shape (m, 3).
        fidelity: The measures over the whole surface.
        free: The measures over what is not restrained: volume, surface and samples
            whose closest point of the target lies on a face outside the BRR.
        deviation: e2 at the vertices.
        voids: Empty space inside, which a scanner does not see.
        volume_mm3: Volume inside the outer surface.
        bead_volume_mm3: Volume of the beads by section and length.
        voxel_mm: Resolution of the field.
    """

    vertices: Floats
    faces: Ints
    fidelity: Fidelity
    free: Fidelity
    deviation: Deviation
    voids: Voids
    volume_mm3: float
    bead_volume_mm3: float
    voxel_mm: float

    def as_dict(self) -> dict[str, Any]:
        """The figures of `fidelity.json`."""
        return {
            **self.fidelity.as_dict(),
            "free": self.free.as_dict(),
            "voids": {
                "count": self.voids.count,
                "volume_mm3": round(self.voids.volume_mm3, 3),
                "largest_mm3": round(self.voids.largest_mm3, 3),
            },
            "volume_mm3": round(self.volume_mm3, 3),
            "bead_volume_mm3": round(self.bead_volume_mm3, 3),
            "voxel_mm": self.voxel_mm,
        }


def simulate(
    beads: BeadRows | ToolpathSet,
    target: Part,
    *,
    voxel_mm: float = 0.1,
    plate_z_mm: float = 0.0,
    substrate: TriangleGeometry | None = None,
    dispensing: Dispensing = PERFECT,
    scanner: Scanner = IDEAL,
    seed: int = 0,
    report: Report = silent,
) -> VirtualPrint:
    """Print virtually, and measure the outcome.

    Each bead is a stadium section laid along its pass with the tool's axis; the print
    is the union of the beads above the plate and the substrate. There is no sagging and
    no flow: what two beads claim twice does not go elsewhere.

    Args:
        beads: What to deposit, part frame.
        target: What the print is compared with.
        voxel_mm: Distance between the nodes of the signed field.
        plate_z_mm: Height of the build plate in the part frame.
        substrate: Closed mesh of what the print stands on, part frame.
        dispensing: Errors of the dispenser and the robot.
        scanner: Errors of the scanner.
        seed: Seed of these errors.
        report: Told how far it is; may raise `Cancelled`.

    Returns:
        The print's outer surface and its fidelity.

    Raises:
        InvalidInput: If the voxels are too small for the memory, or a section is bad.
    """
    if isinstance(beads, ToolpathSet):
        beads = beads_of(beads)
    beads = dispensed(beads, dispensing, seed)
    surface = SurfaceDistance(target.vertices, target.faces)
    grid = _grid(beads, target, voxel_mm)
    report(Progress(STAGE, 0.02))
    printed = bead_field(beads, grid, PROBE_MM + voxel_mm)
    report(Progress(STAGE, 0.3))
    if substrate is not None:
        # taken off it before it is scanned: the gap between the two is no void
        np.maximum(printed, -_field_of(substrate, grid), out=printed)
    voids = fill_voids(printed, grid, plate_z_mm)
    cut_below(printed, grid, plate_z_mm)
    report(Progress(STAGE, 0.45))
    vertices, faces = extract_surface(printed, grid)
    report(Progress(STAGE, 0.6))
    wanted = mesh_field(surface, grid)
    report(Progress(STAGE, 0.7))
    volumes = _compare(beads, printed, wanted, grid, surface, target.restrained, plate_z_mm)
    del printed, wanted
    report(Progress(STAGE, 0.85))
    vertices, faces = scanned(vertices, faces, scanner, seed)
    deviation = measure_deviation(vertices, faces, surface, target.restrained)
    report(Progress(STAGE, 0.93))
    samples, sample_faces = sample_surface(target, TARGET_SAMPLES)
    back = SurfaceDistance(vertices, faces).query(samples, signed=False).signed
    loose = ~target.restrained[sample_faces]
    report(Progress(STAGE, 1.0))
    return VirtualPrint(
        vertices=vertices,
        faces=faces,
        fidelity=_fidelity(volumes.all, target.volume, surface_figures(deviation, back)),
        free=_fidelity(
            volumes.free,
            target.volume,
            surface_figures(deviation, back[loose], deviation.free),
        ),
        deviation=deviation,
        voids=voids,
        volume_mm3=volumes.printed,
        bead_volume_mm3=beads.volume_mm3,
        voxel_mm=voxel_mm,
    )


def _grid(beads: BeadRows, target: Part, voxel_mm: float) -> Grid:
    joined = np.flatnonzero(beads.joined)
    used = np.union1d(joined, joined + 1)
    reach = float(np.maximum(beads.width, beads.height)[used].max() / 2) if len(used) else 0.0
    points = np.concatenate([beads.points[used] - reach, beads.points[used] + reach])
    points = np.concatenate([points, target.bounds])
    return Grid.around(points.min(0), points.max(0), voxel_mm, PROBE_MM + 4 * voxel_mm)


def _field_of(body: TriangleGeometry, grid: Grid) -> Field:
    """Compute the signed distance to what the print stands on.

    Bodies cut out of each other have walls without thickness here and there: two faces at
    one place, of which the nearest may be either. So the side is counted along columns.
    """
    field = mesh_field(SurfaceDistance(body.vertices, body.faces), grid)
    solid = np.zeros(grid.shape[::-1], np.bool_)
    fill_mesh(body.vertices, body.faces, grid.origin, grid.voxel_mm, solid)
    away = np.abs(field)
    return np.where(solid.transpose(2, 1, 0), -away, away)


@dataclass(frozen=True)
class _Volumes:
    """Under- and overshoot [mm³], everywhere and where not restrained."""

    all: tuple[float, float]
    free: tuple[float, float]
    printed: float


def _compare(
    beads: BeadRows,
    printed: Field,
    wanted: Field,
    grid: Grid,
    surface: SurfaceDistance,
    restrained: Bools,
    plate_z_mm: float,
) -> _Volumes:
    """Measure by volume where print and target differ."""
    voxel = grid.voxel_mm**3
    last = grid.shape[0] - 1
    segments = bead_segments(beads, grid)

    def compare(slab: slice) -> tuple[Ints, Floats, Floats]:
        planes = slice(slab.start, min(slab.stop, last))
        cells, samples = surface_samples(segments, printed, grid, planes, plate_z_mm)
        differing, parts, volumes = volume_kernels.compare_fields(
            printed, wanted, planes.start, planes.stop, cells, samples
        )
        return differing, parts, volumes

    results = map_threads(compare, grid.slabs())
    cells = np.concatenate([cells for cells, _, _ in results])
    parts = np.concatenate([parts for _, parts, _ in results]) * voxel
    everywhere = parts.sum(0)
    free = everywhere
    if restrained.any():
        z, y, x = np.unravel_index(cells, grid.shape)
        centres = grid.origin + grid.voxel_mm * (np.column_stack([x, y, z]) + 0.5)
        found = surface.query(centres)
        free = parts[surface.touching(~restrained)[found.faces, found.features]].sum(0)
    return _Volumes(
        all=(float(everywhere[0]), float(everywhere[1])),
        free=(float(free[0]), float(free[1])),
        printed=float(sum(volumes[0] for _, _, volumes in results)) * voxel,
    )


def _fidelity(
    volumes: tuple[float, float], whole: float, figures: tuple[float, float, float, float]
) -> Fidelity:
    under, over = (100 * volume / whole for volume in volumes)
    return Fidelity(under + over, under, over, *figures)


def read_target(folder: str | Path) -> Part:
    """Read the target of a result folder, with its restrained faces.

    Raises:
        InvalidInput: If a file is missing or cannot be read.
    """
    from vega_planner.results.ply import read_mesh_ply

    folder = Path(folder)
    for name in ("part.ply", "toolpath.csv"):
        if not (folder / name).is_file():
            reason = f"it has no {name}" if folder.is_dir() else "no such folder"
            raise InvalidInput(f"{folder} is not the result folder of a plan: {reason}")
    vertices, faces, _ = read_mesh_ply(folder / "part.ply")
    restrained = np.zeros(len(faces), bool)
    if (folder / "restraint.ply").exists():
        points, chosen, _ = read_mesh_ply(folder / "restraint.ply")
        wanted = {tuple(sorted(map(tuple, points[face]))) for face in chosen}
        restrained = np.array(
            [tuple(sorted(map(tuple, vertices[face]))) in wanted for face in faces]
        )
    return Part(folder.resolve().name, vertices, faces, restrained)


def simulate_folder(
    folder: str | Path,
    *,
    voxel_mm: float = 0.1,
    noise_mm: float = 0.0,
    seed: int = 0,
    report: Report = silent,
) -> dict[str, Any]:
    """Print a result folder virtually; writes `printed.ply` and `fidelity.json` into it.

    Args:
        folder: Result folder of `vega plan` or `vega slice`.
        voxel_mm: Distance between the nodes of the signed field.
        noise_mm: Standard deviation of the scanner's noise.
        seed: Seed of the noise.
        report: Told how far it is; may raise `Cancelled`.

    Returns:
        The figures of `fidelity.json`.

    Raises:
        InvalidInput: If the folder does not hold a plan.
        OutputError: If it cannot be written.
    """
    from vega_planner.results.folder import write_folder
    from vega_planner.results.ply import mesh_ply

    folder = Path(folder)
    check_voxel(voxel_mm)
    target = read_target(folder)
    result = simulate(
        read_beads(folder / "toolpath.csv"),
        target,
        voxel_mm=voxel_mm,
        plate_z_mm=plate_height(folder),
        substrate=_read_substrate(folder),
        scanner=Scanner(noise_mm=noise_mm),
        seed=seed,
        report=report,
    )
    figures = result.as_dict()
    deviation = {"deviation": result.deviation.signed}
    write_folder(
        folder,
        {
            "printed.ply": mesh_ply(result.vertices, result.faces, deviation),
            "fidelity.json": (json.dumps(figures, indent=2) + "\n").encode(),
        },
    )
    return figures


def check_voxel(voxel_mm: float) -> None:
    """Refuse a voxel size that means nothing.

    Raises:
        InvalidInput: If it is not a length above zero.
    """
    if not 0 < voxel_mm < float("inf"):
        raise InvalidInput(f"voxel size {voxel_mm:g} mm; must be above 0")


def plate_height(folder: Path) -> float:
    """Read the height of the build plate in the part frame [mm] from a plan's summary."""
    try:
        summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
        return float(summary.get("plate_z_mm", 0.0))
    except (OSError, ValueError, TypeError):
        return 0.0


def _read_substrate(folder: Path) -> TriangleGeometry | None:
    path = folder / "substrate.stl"
    if not path.exists():
        return None
    from vega_planner.part.readers import read_mesh

    raw = read_mesh(path)
    return Part("substrate", raw.vertices, raw.faces, np.zeros(len(raw.faces), bool))
