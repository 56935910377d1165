# SPDX-License-Identifier: Apache-2.0
"""Reading a result folder back: part, layers, toolpath over time, figures."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vega_planner.datatypes import Bools, Floats, Ints, Layer, Part, TriangleGeometry
from vega_planner.errors import InvalidInput
from vega_planner.results.ply import read_mesh_ply
from vega_planner.results.tables import read_table
from vega_planner.settings import Settings, load_settings
from vega_planner.viewer.timeline import Timeline, row_times

_TOOLPATH = (
    "path_id", "layer", "x_mm", "y_mm", "z_mm", "tool_x", "tool_y", "tool_z", "extrude",
)  # fmt: skip
_TRAJECTORY = ("t_s", "extrude", "path_id")
_TOLD_BY_SUMMARY = {
    "layer_thickness_mm": ("layers", "thickness_mm"),
    "engine": ("layers", "engine"),
    "bead_width_mm": ("toolpaths", "width_mm"),
    "robot": ("cell", "robot"),
    "tool": ("cell", "tool"),
    "material": ("cell", "material"),
}


@dataclass(frozen=True, eq=False)
class ResultFolder:
    """What a plan left on disk.

    Attributes:
        path: The folder.
        part: The target, with its restraint region.
        sheets: Envelope layers, then cores.
        face_reasons: Per sheet 0 where a face is printable, else 1 + index into
            `REASON_CODES`, shape (m,).
        timeline: The toolpath over time; None where the plan has no toolpath.
        summary: Content of `summary.json`.
        settings: What it was planned with.
        T_base_part: Pose of the part in the robot's base [m], shape (4, 4).
    """

    path: Path
    part: Part
    sheets: tuple[Layer, ...]
    face_reasons: tuple[Ints, ...]
    timeline: Timeline | None
    summary: dict[str, Any] = field(default_factory=dict)
    settings: Settings = field(default_factory=Settings)

    @property
    def T_base_part(self) -> Floats:
        """Pose of the part in the robot's base [m], shape (4, 4); identity where unknown."""
        return np.array(self.summary.get("T_base_part", np.eye(4)), dtype=np.float64)


def read_result(folder: str | Path) -> ResultFolder:
    """Read a result folder of `vega plan` or `vega slice`.

    Raises:
        InvalidInput: If a file is missing or cannot be read.
    """
    path = Path(folder)
    summary = _summary(path / "summary.json")
    part = _part(path, summary)
    sheets: list[Layer] = []
    reasons: list[Ints] = []
    kinds = {"layer": "planar" if summary.get("engine") == "planar" else "envelope"}
    files = [*sorted(path.glob("layers/layer_*.ply")), *sorted(path.glob("layers/core_*.ply"))]
    for file in files:
        sheet, reason = _sheet(file, len(sheets), kinds.get(file.stem[:5], "core"), summary)
        sheets.append(sheet)
        reasons.append(reason)
    timeline = _timeline(path, summary) if (path / "toolpath.csv").is_file() else None
    settings, _ = result_settings(path)
    return ResultFolder(path, part, tuple(sheets), tuple(reasons), timeline, summary, settings)


def result_settings(folder: Path) -> tuple[Settings, Path | None]:
    """Read what a result was planned with.

    Returns:
        The settings, and the file that holds them; where an older result has no such file,
        what its summary tells, and None.

    Raises:
        InvalidInput: If a file cannot be read.
    """
    file = folder / "settings.yaml"
    if file.is_file():
        return load_settings(file), file
    summary = _summary(folder / "summary.json")
    changes: dict[str, dict[str, Any]] = {}
    for key, (section, name) in _TOLD_BY_SUMMARY.items():
        if key in summary and summary[key] != "planar":
            changes.setdefault(section, {})[name] = summary[key]
    return Settings().updated(changes), None


def _summary(path: Path) -> dict[str, Any]:
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InvalidInput(f"summary {path} cannot be read: {error}") from error
    if not isinstance(values, dict):
        raise InvalidInput(f"summary {path} holds no keys and values")
    return values


def _part(folder: Path, summary: dict[str, Any]) -> Part:
    vertices, faces, _ = read_mesh_ply(folder / "part.ply")
    restrained = np.zeros(len(faces), dtype=bool)
    if (folder / "restraint.ply").is_file():
        region_vertices, region_faces, _ = read_mesh_ply(folder / "restraint.ply")
        restrained = faces_in_common(vertices, faces, region_vertices, region_faces)
    brr = tuple(summary.get("brr", {}).get("spec", ()))
    return Part(
        name=str(summary.get("mesh", folder.name)),
        vertices=vertices,
        faces=faces,
        restrained=restrained,
        brr=brr or ("none",),
        source=str(folder / "part.ply"),
    )


def faces_in_common(
    vertices: Floats, faces: Ints, some_vertices: Floats, some_faces: Ints
) -> Bools:
    """Find the faces of a mesh that also occur in a piece cut out of it.

    Args:
        vertices: Points of the mesh, shape (n, 3).
        faces: Its faces, shape (m, 3).
        some_vertices: Points of the piece, bit for bit as in the mesh.
        some_faces: Faces of the piece.

    Returns:
        True for the mesh's faces that are in the piece, shape (m,).
    """
    count = len(vertices)
    _, label = np.unique(np.concatenate([vertices, some_vertices]), axis=0, return_inverse=True)
    keys = np.sort(label.ravel()[:count][faces], axis=1)
    wanted = np.sort(label.ravel()[count:][some_faces], axis=1)
    return np.isin(_packed(keys, len(label)), _packed(wanted, len(label)))


def _packed(triples: Ints, base: int) -> NDArray[Any]:
    table = np.ascontiguousarray(triples, dtype=np.int64)
    return table.view([("a", "<i8"), ("b", "<i8"), ("c", "<i8")]).ravel() if base else table


def _sheet(file: Path, index: int, kind: str, summary: dict[str, Any]) -> tuple[Layer, Ints]:
    vertices, faces, extra = read_mesh_ply(file)
    nominal = float(summary.get("layer_thickness_mm", 1.0))
    number = int(file.stem.split("_")[1])
    depth = (number + 0.5) * nominal
    if kind == "core":
        cores = summary.get("cores", [])
        depth = float(cores[number]["depth_mm"]) if number < len(cores) else 0.0
    sheet = Layer(
        index=index,
        kind=kind,
        depth_mm=depth,
        vertices=vertices,
        faces=faces,
        thickness=extra.get("thickness", np.full(len(vertices), nominal)),
    )
    return sheet, extra.get("reason", np.zeros(len(faces))).astype(np.int64)


def _timeline(folder: Path, summary: dict[str, Any]) -> Timeline | None:
    rows = read_table(folder / "toolpath.csv", _TOOLPATH)
    if not len(rows["x_mm"]):
        return None
    points = np.column_stack([rows[name] for name in ("x_mm", "y_mm", "z_mm")])
    path_id = rows["path_id"].astype(np.int64)
    names: tuple[str, ...] = ()
    sample_times, positions = np.zeros(0), np.zeros((0, 0))
    sample_path = np.zeros(0, dtype=np.int64)
    if (folder / "trajectory.csv").is_file():
        samples = read_table(folder / "trajectory.csv", _TRAJECTORY)
        names = tuple(name for name in samples if name not in _TRAJECTORY)
        sample_times = samples["t_s"]
        positions = np.column_stack([samples[name] for name in names])
        sample_path = samples["path_id"].astype(np.int64)
    times = row_times(
        points, path_id, sample_times, sample_path, float(summary.get("print_time_s", 0.0))
    )
    return Timeline(
        points=points,
        axes=np.column_stack([rows[name] for name in ("tool_x", "tool_y", "tool_z")]),
        layer=rows["layer"].astype(np.int64),
        path_id=path_id,
        extrude=rows["extrude"] > 0,
        times=times,
        joint_names=names,
        joint_times=sample_times,
        joint_positions=positions,
        joint_path=sample_path,
    )


def coloured_submesh(mesh: TriangleGeometry, chosen: Bools, lift_mm: float) -> tuple[Floats, Ints]:
    """Cut faces out of a mesh and push them out a little, so that they cover it.

    Args:
        mesh: The mesh.
        chosen: Faces to cut out, shape (m,).
        lift_mm: How far to push them along the vertex normals [mm].

    Returns:
        Vertices and faces of the piece.
    """
    used, flat = np.unique(mesh.faces[chosen], return_inverse=True)
    return mesh.vertices[used] + lift_mm * mesh.vertex_normals[used], flat.reshape(-1, 3)
