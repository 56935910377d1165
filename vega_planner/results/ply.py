# SPDX-License-Identifier: Apache-2.0
"""Binary PLY files: the meshes of the result folder."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from vega_planner.datatypes import Floats, Ints
from vega_planner.errors import InvalidInput


def mesh_ply(
    vertices: Floats,
    faces: Ints,
    per_vertex: Mapping[str, Floats] | None = None,
    per_face: Mapping[str, Ints] | None = None,
) -> bytes:
    """Encode a triangle mesh as little-endian binary PLY with double coordinates.

    Args:
        vertices: Points [mm], shape (n, 3).
        faces: Vertex indices, shape (m, 3).
        per_vertex: Further float properties by name, each of shape (n,).
        per_face: Further properties of the faces by name, 0 to 255, each of shape (m,).
    """
    extra = dict(per_vertex or {})
    vertex_type = [(axis, "<f8") for axis in "xyz"] + [(name, "<f4") for name in extra]
    table = np.zeros(len(vertices), vertex_type)
    for k, axis in enumerate("xyz"):
        table[axis] = vertices[:, k]
    for name, values in extra.items():
        table[name] = values
    marks = dict(per_face or {})
    rows = np.zeros(len(faces), _face_type(list(marks)))
    rows["n"], rows["v"] = 3, faces
    for name, values in marks.items():
        rows[name] = values
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment millimetres, part frame, z up",
        f"element vertex {len(vertices)}",
        *(f"property double {axis}" for axis in "xyz"),
        *(f"property float {name}" for name in extra),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        *(f"property uchar {name}" for name in marks),
        "end_header",
    ]
    return ("\n".join(header) + "\n").encode() + table.tobytes() + rows.tobytes()


def _face_type(marks: list[str]) -> np.dtype:
    return np.dtype([("n", "u1"), ("v", "<i4", (3,)), *((name, "u1") for name in marks)])


def read_mesh_ply(path: str | Path) -> tuple[Floats, Ints, dict[str, Floats]]:
    """Read a PLY file written by `mesh_ply`.

    Returns:
        Vertices (n, 3), faces (m, 3) and the further properties by name, those of the
        vertices with n and those of the faces with m values.

    Raises:
        InvalidInput: If the file is missing or has another layout.
    """
    try:
        data = Path(path).read_bytes()
        head, body = data.split(b"end_header\n", 1)
        lines = head.decode("ascii").splitlines()
        counts = [int(line.split()[2]) for line in lines if line.startswith("element")]
        names = [line.split()[2] for line in lines if line.startswith("property float")]
        vertex_type = np.dtype([(axis, "<f8") for axis in "xyz"] + [(n, "<f4") for n in names])
        table = np.frombuffer(body, vertex_type, counts[0])
        marks = [line.split()[2] for line in lines if line.startswith("property uchar")]
        rows = np.frombuffer(body, _face_type(marks), counts[1], counts[0] * vertex_type.itemsize)
    except (OSError, ValueError, IndexError) as error:
        raise InvalidInput(f"mesh {path} cannot be read: {error}") from error
    vertices = np.column_stack([table[axis] for axis in "xyz"])
    extra = {name: table[name].astype(np.float64) for name in names}
    extra |= {name: rows[name].astype(np.int64) for name in marks}
    return vertices, rows["v"].astype(np.int64), extra
