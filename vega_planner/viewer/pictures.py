# SPDX-License-Identifier: Apache-2.0
"""Pictures without a screen: an orthographic view, a depth buffer, and PNG.

For reports that need a few still pictures in a fraction of a second, on machines
without a display; the same bytes every time.
"""

from __future__ import annotations

import base64
import struct
import zlib
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vega_planner.datatypes import Bools, Floats, Ints
from vega_planner.viewer import raster_kernels as kernels

Image = NDArray[np.uint8]
Colours = NDArray[np.float32]

#: Pixels are drawn this much finer and averaged.
_FINER = 2
#: Blue over light grey to red: short to long, inside to outside.
_DIVERGING = np.array(
    [(33, 79, 158), (96, 148, 205), (178, 208, 230), (240, 240, 236), (246, 196, 160),
     (222, 119, 84), (165, 30, 40)],
    np.float64,
)  # fmt: skip
#: From dark blue to yellow, for what has an order.
_SEQUENTIAL = np.array(
    [(48, 40, 110), (44, 90, 150), (35, 140, 150), (60, 180, 120), (160, 210, 80),
     (245, 220, 60)],
    np.float64,
)  # fmt: skip


@dataclass(frozen=True)
class View:
    """An orthographic view with z upright.

    Attributes:
        azimuth_deg: Direction of the eye about z, from the x axis.
        elevation_deg: Height of the eye above the horizon.
        width: Width of the picture in pixels.
        height: Height of the picture in pixels.
    """

    azimuth_deg: float = -60.0
    elevation_deg: float = 28.0
    width: int = 420
    height: int = 320

    @property
    def axes(self) -> Floats:
        """Directions to the right, down, and to the eye, as rows, shape (3, 3)."""
        a, e = np.radians([self.azimuth_deg, self.elevation_deg])
        eye = np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)])
        right = np.array([-np.sin(a), np.cos(a), 0.0])
        return np.array([right, np.cross(right, eye), eye])


@dataclass
class Scene:
    """Meshes and lines to be drawn together.

    Attributes:
        meshes: Vertices (n, 3), faces (m, 3) and colours of the vertices (n, 3).
        lines: Points (n, 3), where they are joined (n - 1,), colours (n, 3).
    """

    meshes: list[tuple[Floats, Ints, Colours]] = field(default_factory=list)
    lines: list[tuple[Floats, Bools, Colours]] = field(default_factory=list)

    def add_mesh(self, vertices: Floats, faces: Ints, colours: ArrayLike) -> None:
        """Add a mesh; one colour (3,) or one for each vertex (n, 3), 0 to 255."""
        if not len(faces):
            return
        shades = _shades(colours, len(vertices))
        self.meshes.append((vertices, faces, shades))

    def add_lines(self, points: Floats, joined: Bools, colours: ArrayLike) -> None:
        """Add lines between consecutive points where joined; colours as for meshes."""
        shades = _shades(colours, len(points))
        self.lines.append((points, joined, shades))


def _shades(colours: ArrayLike, count: int) -> Colours:
    return np.ascontiguousarray(np.broadcast_to(np.asarray(colours, np.float32), (count, 3)))


def draw(scene: Scene, view: View, line_width_mm: float = 0.0) -> Image:
    """Draw a scene on white, filling the picture.

    Args:
        scene: What to draw.
        view: Where from, and how large.
        line_width_mm: Width of lines; at least a pixel.

    Returns:
        Picture, shape (height, width, 3) uint8.
    """
    turned = view.axes.T
    meshes = [(vertices @ turned, faces, colours) for vertices, faces, colours in scene.meshes]
    lines = [(points @ turned, joined, colours) for points, joined, colours in scene.lines]
    low, high = _bounds(
        [_used(points, faces) for points, faces, _ in meshes] + [p for p, *_ in lines]
    )
    size = np.array([view.width, view.height]) * _FINER
    scale = 0.94 * float((size / np.maximum(high[:2] - low[:2], 1e-9)).min())
    shift = np.append(size / 2, 0.0) - scale * (low + high) / 2
    image = np.full((size[1], size[0], 3), 255, np.float32)
    depth = np.full((size[1], size[0]), -np.inf, np.float32)
    light = np.array([-0.35, -0.55, 0.76])
    for vertices, faces, colours in meshes:
        kernels.draw_triangles(image, depth, vertices * scale + shift, faces, colours, light)
    radius = 0.5 * max(line_width_mm * scale, _FINER)
    for points, joined, colours in lines:
        kernels.draw_lines(image, depth, points * scale + shift, joined, colours, radius, 2.0)
    return kernels.average(image, _FINER)


def _used(points: Floats, faces: Ints) -> Floats:
    used = np.zeros(len(points), bool)
    used[faces.ravel()] = True
    return points if used.all() else points[used]


def _bounds(clouds: list[Floats]) -> tuple[Floats, Floats]:
    """Lowest and highest corner of all points; a unit box where there are none."""
    clouds = [cloud for cloud in clouds if len(cloud)] or [np.zeros((1, 3)), np.ones((1, 3))]
    lows = [[cloud[:, k].min() for k in range(3)] for cloud in clouds]
    highs = [[cloud[:, k].max() for k in range(3)] for cloud in clouds]
    return np.min(lows, axis=0), np.max(highs, axis=0)


def png(image: Image) -> bytes:
    """Encode a picture as PNG.

    Args:
        image: Shape (h, w, 3) uint8.
    """
    height, width, _ = image.shape
    rows = image.reshape(height, width * 3)
    # Each row as its difference to the row above, which is mostly zero.
    above = np.zeros_like(rows)
    above[1:] = rows[:-1]
    lines = np.empty((height, 1 + width * 3), np.uint8)
    lines[:, 0] = 2
    np.subtract(rows, above, out=lines[:, 1:])
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + _chunk(b"IHDR", header)
        + _chunk(b"IDAT", zlib.compress(lines.tobytes(), 4))
        + _chunk(b"IEND", b"")
    )


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def data_uri(image: Image) -> str:
    """Turn a picture into what an `<img>` of a self-contained page has as its source."""
    return "data:image/png;base64," + base64.b64encode(png(image)).decode("ascii")


def diverging(values: Floats, limit: float) -> Floats:
    """Colour signed values: blue below zero, light grey at it, red above.

    Args:
        values: Numbers, shape (n,).
        limit: Magnitude of the strongest colours.

    Returns:
        Colours, shape (n, 3), 0 to 255.
    """
    return _ramp(_DIVERGING, 0.5 + 0.5 * np.asarray(values) / max(limit, 1e-12))


def sequential(shares: Floats) -> Floats:
    """Colour numbers from 0 to 1 by an ordered scale, shape (n, 3), 0 to 255."""
    return _ramp(_SEQUENTIAL, np.asarray(shares, np.float64))


def _ramp(colours: Floats, shares: Floats) -> Floats:
    at = np.linspace(0, 1, len(colours))
    return np.stack([np.interp(shares, at, colours[:, k]) for k in range(3)], axis=-1)
