# SPDX-License-Identifier: Apache-2.0
"""Binary glTF with unlit vertex colours: what a software renderer draws fastest.

One draw call per mesh, no light, lines one pixel wide. Container and fields after
[glTF2]_, sections 4 and 5, with the extension KHR_materials_unlit.
"""

from __future__ import annotations

import json
import struct
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vega_planner.datatypes import Floats, face_cross

_LINES, _TRIANGLES = 1, 4
_FLOAT, _UINT32, _USHORT = 5126, 5125, 5123
_ARRAY_BUFFER, _INDEX_BUFFER = 34962, 34963


def lines_glb(points: Floats, segments: NDArray, colours: NDArray) -> bytes:
    """Encode line segments.

    Args:
        points: Positions, shape (n, 3), n >= 1.
        segments: Point indices, shape (k, 2), k >= 1.
        colours: sRGB 0..255 of the points, shape (n, 3).
    """
    return _encode(_LINES, points, segments, colours)


def triangles_glb(vertices: Floats, faces: NDArray, colours: NDArray) -> bytes:
    """Encode a triangle mesh that is seen from both sides; arguments as in `lines_glb`."""
    return _encode(_TRIANGLES, vertices, faces, colours)


def baked_colours(
    normals: Floats, colour: tuple[int, int, int], contrast: float = 1.0
) -> NDArray[np.uint8]:
    """Shade one colour by the direction of the surface, as light from above left would.

    Args:
        normals: Unit normals, shape (n, 3).
        colour: sRGB 0..255.
        contrast: 1 as other things are, 0 without any shade.

    Returns:
        sRGB 0..255, shape (n, 3).
    """
    light = np.array([0.35, -0.45, 0.82])
    shade = 0.62 + 0.38 * (normals @ (light / np.linalg.norm(light)))
    shade = 1.0 - contrast * (1.0 - np.clip(shade, 0.3, 1.0))
    return (np.array(colour) * shade[:, None]).astype(np.uint8)


def shaded_glb(
    vertices: Floats,
    faces: NDArray,
    colour: tuple[int, int, int],
    opacity: float = 1.0,
    contrast: float = 1.0,
) -> bytes:
    """Encode a triangle mesh in one colour, each face shaded by its own direction.

    Args:
        vertices: Positions, shape (n, 3).
        faces: Vertex indices, shape (m, 3), m >= 1.
        colour: sRGB 0..255.
        opacity: 0 to 1.
        contrast: 1 as other things are, 0 without any shade.
    """
    cross = face_cross(vertices, faces)
    length = np.linalg.norm(cross, axis=1, keepdims=True)
    colours = baked_colours(cross / np.where(length > 0, length, 1.0), colour, contrast)
    corners = vertices[faces].reshape(-1, 3)
    indices = np.arange(len(corners))
    return _encode(_TRIANGLES, corners, indices, np.repeat(colours, 3, axis=0), opacity)


def _before_tone_mapping(srgb: Floats) -> Floats:
    """The linear colour that the browser shows as a given sRGB colour.

    The client passes colours through the filmic curve of [Hill2015]_ at exposure 1 / 0.6:
    y = (x (x + a) - b) / (x (c x + d) + e). This is its inverse, channel by channel.

    Args:
        srgb: 0 to 1, any shape; what is brighter than the curve reaches is cut.
    """
    a, b, c, d, e = 0.0245786, 0.000090537, 0.983729, 0.4329510, 0.238081
    y = np.asarray(srgb, dtype=np.float64) ** 2.2
    square, slope, rest = 1 - c * y, a - d * y, -b - e * y
    x = (-slope + np.sqrt(slope * slope - 4 * square * rest)) / (2 * square)
    return np.clip(0.6 * x, 0.0, 1.0)


@cache
def _linear_table() -> NDArray[np.uint16]:
    """Linear colours 0..65535 of sRGB 0..255."""
    return np.round(65535 * _before_tone_mapping(np.arange(256) / 255.0)).astype("<u2")


def _encode(
    mode: int, points: Floats, indices: NDArray, colours: NDArray, opacity: float = 1.0
) -> bytes:
    positions = np.ascontiguousarray(points, dtype="<f4")
    flat = np.ascontiguousarray(indices, dtype="<u4").ravel()
    linear = np.full((len(positions), 4), 65535, dtype="<u2")
    linear[:, :3] = _linear_table()[np.asarray(colours).astype(np.uint8)]
    chunks = [positions.tobytes(), linear.tobytes(), flat.tobytes()]
    starts = np.cumsum([0, *(len(chunk) for chunk in chunks)]).tolist()
    views = [
        {"buffer": 0, "byteOffset": start, "byteLength": len(chunk), "target": target}
        for start, chunk, target in zip(
            starts, chunks, (_ARRAY_BUFFER, _ARRAY_BUFFER, _INDEX_BUFFER)
        )
    ]
    accessors = [
        {
            "bufferView": 0,
            "componentType": _FLOAT,
            "count": len(positions),
            "type": "VEC3",
            "min": positions.min(0).tolist(),
            "max": positions.max(0).tolist(),
        },
        {
            "bufferView": 1,
            "componentType": _USHORT,
            "normalized": True,
            "count": len(positions),
            "type": "VEC4",
        },
        {"bufferView": 2, "componentType": _UINT32, "count": len(flat), "type": "SCALAR"},
    ]
    primitive = {
        "attributes": {"POSITION": 0, "COLOR_0": 1},
        "indices": 2,
        "mode": mode,
        "material": 0,
    }
    material: dict[str, Any] = {
        "extensions": {"KHR_materials_unlit": {}},
        "doubleSided": True,
    }
    if opacity < 1:
        material["alphaMode"] = "BLEND"
        material["pbrMetallicRoughness"] = {"baseColorFactor": [1.0, 1.0, 1.0, opacity]}
    header = {
        "asset": {"version": "2.0"},
        "extensionsUsed": ["KHR_materials_unlit"],
        "buffers": [{"byteLength": starts[-1]}],
        "bufferViews": views,
        "accessors": accessors,
        "materials": [material],
        "meshes": [{"primitives": [primitive]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    }
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    body = b"".join(chunks)
    body += b"\0" * (-len(body) % 4)
    total = 12 + 8 + len(text) + 8 + len(body)
    return (
        struct.pack("<4sII", b"glTF", 2, total)
        + struct.pack("<I4s", len(text), b"JSON")
        + text
        + struct.pack("<I4s", len(body), b"BIN\0")
        + body
    )
