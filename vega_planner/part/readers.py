# SPDX-License-Identifier: Apache-2.0
"""Reading of mesh files: STL and PLY with numpy alone, the rest through trimesh.

Every format gives the same: vertices, triangles, and the unit where the file states it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import numpy as np

from vega_planner.datatypes import Floats, Ints
from vega_planner.errors import BadMesh
from vega_planner.units import m_to_mm

FORMATS = ("stl", "obj", "ply", "3mf", "off", "step", "stp")

#: Meshing of STEP's curved faces: 0.01 mm is a hundredth of a bead; the angle [rad]
#: keeps small fillets round.
STEP_MESHING: dict[str, Any] = {"tol_linear": 0.01, "tol_angular": 0.2}


@dataclass(frozen=True)
class RawMesh:
    """Triangles as a file holds them: nothing welded, checked or scaled.

    Attributes:
        name: Stem of the file, or what the caller called it.
        vertices: Points in the file's unit, shape (n, 3).
        faces: Vertex indices, shape (m, 3).
        unit: Unit the file states ("mm", "m", "inch", ...), or empty.
    """

    name: str
    vertices: Floats
    faces: Ints
    unit: str = ""


def source_path(source: str | Path) -> Path:
    """Turn a path or a file:// URI into a path.

    Raises:
        BadMesh: If the URI has another scheme.
    """
    text = str(source)
    if "://" in text:
        parts = urlsplit(text)
        if parts.scheme != "file":
            raise BadMesh(f"mesh '{text}' is not a file:// URI; choices: a path, file:///path")
        return Path(unquote(parts.path))
    return Path(text).expanduser()


def read_mesh(path: Path) -> RawMesh:
    """Read a mesh file.

    Args:
        path: File whose ending names the format, one of `FORMATS` in any case.

    Raises:
        BadMesh: If the file is missing, empty, of an unknown format or cannot be read.
    """
    ending = path.suffix.lower().lstrip(".")
    try:
        data = path.read_bytes()
    except FileNotFoundError as error:
        raise BadMesh(f"mesh {path} does not exist") from error
    except OSError as error:
        raise BadMesh(f"mesh {path} cannot be read: {error.strerror or error}") from error
    if ending not in FORMATS:
        raise BadMesh(f"mesh {path} has format '{ending}'; choices: {', '.join(FORMATS)}")
    if not data:
        raise BadMesh(f"mesh {path} is empty (0 bytes)")
    try:
        vertices, faces, unit = _READERS[ending](data, ending)
    except BadMesh as error:
        raise BadMesh(f"mesh {path}: {error}") from error
    except MemoryError:
        raise
    except Exception as error:
        reason = (str(error).splitlines() or [""])[0] or type(error).__name__
        raise BadMesh(f"mesh {path} cannot be read as {ending.upper()}: {reason}") from error
    if len(faces) == 0:
        raise BadMesh(f"mesh {path} holds no triangle")
    return RawMesh(path.stem, vertices, faces, unit)


def _soup(corners: Floats) -> tuple[Floats, Ints, str]:
    corners = np.ascontiguousarray(corners, dtype=np.float64).reshape(-1, 3)
    return corners, np.arange(len(corners), dtype=np.int64).reshape(-1, 3), ""


def _read_stl(data: bytes, ending: str) -> tuple[Floats, Ints, str]:
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    if len(data) >= 84:
        count = int.from_bytes(data[80:84], "little")
        if len(data) == 84 + 50 * count:
            return _soup(np.frombuffer(data, record, count, offset=84)["corners"])
    if data.lstrip()[:5].lower() == b"solid" and b"facet" in data[:4096].lower():
        return _read_ascii_stl(data)
    if len(data) < 84:
        raise BadMesh(f"STL of {len(data)} bytes is too short")
    have = (len(data) - 84) // 50
    if have < count:
        raise BadMesh(f"binary STL announces {count} triangles and holds {have}; it is cut short")
    return _soup(np.frombuffer(data, record, count, offset=84)["corners"])


def _read_ascii_stl(data: bytes) -> tuple[Floats, Ints, str]:
    words = data.lower().split()
    marks = [i for i, word in enumerate(words) if word == b"vertex"]
    if len(marks) % 3 or b"endsolid" not in data[-4096:].lower():
        raise BadMesh("ASCII STL is cut short")
    at = np.array(marks, dtype=np.int64)[:, None] + np.arange(1, 4)
    numbers = np.array([words[i] for i in at.ravel()], dtype="S32").astype(np.float64)
    return _soup(numbers)


_PLY_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}


def _read_ply(data: bytes, ending: str) -> tuple[Floats, Ints, str]:
    """Read a little-endian PLY of plain vertices and triangles; pass others to trimesh."""
    start = data.find(b"end_header\n") + len(b"end_header\n")
    header = data[:start].decode("ascii", "replace").split("\n")
    if "format binary_little_endian 1.0" not in header:
        return _read_with_trimesh(data, ending)
    counts: dict[str, int] = {}
    properties: dict[str, list[list[str]]] = {}
    for line in header:
        words = line.split()
        if words[:1] == ["element"]:
            counts[words[1]] = int(words[2])
            properties[words[1]] = []
        elif words[:1] == ["property"]:
            properties[list(properties)[-1]].append(words[1:])
    if list(counts) != ["vertex", "face"] or any(p[0] == "list" for p in properties["vertex"]):
        return _read_with_trimesh(data, ending)
    lists = properties["face"]
    if len(lists) != 1 or lists[0][0] != "list":
        return _read_with_trimesh(data, ending)
    vertex = np.dtype([(name, "<" + _PLY_TYPES[kind]) for kind, name in properties["vertex"]])
    face = np.dtype(
        [("n", "<" + _PLY_TYPES[lists[0][1]]), ("corners", "<" + _PLY_TYPES[lists[0][2]], 3)]
    )
    middle = start + counts["vertex"] * vertex.itemsize
    if len(data) < middle:
        raise BadMesh("PLY is cut short")
    if len(data) != middle + counts["face"] * face.itemsize:
        return _read_with_trimesh(data, ending)
    rows = np.frombuffer(data, vertex, counts["vertex"], offset=start)
    polygons = np.frombuffer(data, face, counts["face"], offset=middle)
    if (polygons["n"] != 3).any():
        return _read_with_trimesh(data, ending)
    vertices = np.stack([rows["x"], rows["y"], rows["z"]], axis=1).astype(np.float64)
    return vertices, polygons["corners"].astype(np.int64), ""


def _read_with_trimesh(data: bytes, ending: str) -> tuple[Floats, Ints, str]:
    """Read OBJ, OFF, 3MF, STEP and the less common PLY through trimesh."""
    import io
    import logging

    import trimesh

    logging.getLogger("trimesh").setLevel(logging.CRITICAL)
    is_step = ending in ("step", "stp")
    options: dict[str, Any] = STEP_MESHING if is_step else {}
    scene = trimesh.load_scene(
        io.BytesIO(data), file_type="step" if is_step else ending, process=False, **options
    )
    meshes = [m for m in scene.dump() if isinstance(m, trimesh.Trimesh) and len(m.faces)]
    if not meshes:
        raise BadMesh("it holds no triangle")
    offsets = np.cumsum([0] + [len(m.vertices) for m in meshes[:-1]])
    vertices = np.vstack([np.array(m.vertices, dtype=np.float64) for m in meshes])
    faces = np.vstack([np.array(m.faces, dtype=np.int64) + o for m, o in zip(meshes, offsets)])
    if is_step:  # comes as metres, whatever unit the file has
        return m_to_mm(vertices), faces, "mm"
    return vertices, faces, str(scene.units or "")


_READERS = {
    "stl": _read_stl,
    "ply": _read_ply,
    **dict.fromkeys(("obj", "off", "3mf", "step", "stp"), _read_with_trimesh),
}
