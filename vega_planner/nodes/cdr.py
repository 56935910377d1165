# SPDX-License-Identifier: Apache-2.0
"""Marker arrays straight into CDR, the bytes of the wire.

Building a hundred thousand Point objects takes a second; copying their coordinates as one
array takes a millisecond, and `Publisher.publish` takes bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vega_planner.datatypes import Floats

#: Marker types and actions of visualization_msgs.
ARROW, LINE_STRIP, TRIANGLE_LIST = 0, 4, 11
ADD, DELETE_ALL = 0, 3

#: Little-endian plain CDR.
_HEADER = b"\x00\x01\x00\x00"


@dataclass(frozen=True, eq=False)
class ShapeMarker:
    """A marker that consists of points.

    Attributes:
        namespace: What it belongs to; RViz toggles namespaces.
        number: Its number in the namespace.
        kind: `TRIANGLE_LIST`, `LINE_STRIP`, or `ARROW` from the first point to the second.
        points: Points [m], shape (n, 3).
        color: Red, green, blue, opacity, 0 to 1.
        frame: Frame of the points.
        width: Width of a line, or of an arrow's shaft [m].
        colors: Colours of the points, 0 to 1, shape (n, 4), or None for `color` throughout.
    """

    namespace: str
    number: int
    kind: int
    points: Floats
    color: tuple[float, float, float, float]
    frame: str
    width: float = 0.001
    colors: Floats | None = None


class _Writer:
    """Appends values with the alignment of plain CDR."""

    def __init__(self) -> None:
        self._parts: list[bytes | memoryview] = []
        self._size = 0

    def put(self, form: str, *values: float) -> None:
        """Append numbers of one type, aligned to their size."""
        self._align(struct.calcsize(form))
        self._add(struct.pack(f"<{len(values)}{form}", *values))

    def text(self, value: str) -> None:
        """Append a string."""
        data = value.encode() + b"\0"
        self.put("I", len(data))
        self._add(data)

    def rows(self, form: str, values: Floats) -> None:
        """Append the number of rows of an array, then its values as numbers of one type."""
        self.put("I", len(values))
        if values.size:
            self._align(struct.calcsize(form))
            # Not copied before everything is joined.
            self._add(np.ascontiguousarray(values, f"<{form}").data.cast("B"))

    def data(self) -> bytes:
        """Everything so far, with the encapsulation header."""
        return _HEADER + b"".join(self._parts)

    def _align(self, size: int) -> None:
        self._add(b"\0" * (-self._size % size))

    def _add(self, data: bytes | memoryview) -> None:
        self._parts.append(data)
        self._size += len(data)


def marker_array(markers: Sequence[ShapeMarker], *, clear: bool = True) -> bytes:
    """Serialize a visualization_msgs/MarkerArray.

    Args:
        markers: The markers, no two with the same namespace and number.
        clear: Put a marker first that deletes everything shown before.
    """
    out = _Writer()
    out.put("I", len(markers) + clear)
    if clear:
        _marker(out, ShapeMarker("", 0, 0, np.zeros((0, 3)), (0, 0, 0, 0), "part"), DELETE_ALL)
    for marker in markers:
        _marker(out, marker, ADD)
    return out.data()


def _marker(out: _Writer, marker: ShapeMarker, action: int) -> None:
    out.put("i", 0)  # stamp: the latest transform
    out.put("I", 0)
    out.text(marker.frame)
    out.text(marker.namespace)
    out.put("i", marker.number, marker.kind, action)
    out.put("d", 0, 0, 0, 0, 0, 0, 1)  # pose
    width = marker.width
    scales = {LINE_STRIP: (width, 0, 0), ARROW: (width, 2 * width, 4 * width)}
    out.put("d", *scales.get(marker.kind, (1, 1, 1)))
    out.put("f", *marker.color)
    out.put("i", 0)  # lifetime: for ever
    out.put("I", 0)
    out.put("B", 1)  # frame_locked
    out.rows("d", marker.points)
    out.rows("f", np.zeros((0, 4)) if marker.colors is None else marker.colors)
    out.text("")  # texture_resource
    out.put("i", 0)  # texture: header, format, data
    out.put("I", 0)
    out.text("")
    out.text("")
    out.put("I", 0)
    out.put("I", 0)  # uv_coordinates
    out.text("")  # text
    out.text("")  # mesh_resource
    out.text("")  # mesh_file: filename, data
    out.put("I", 0)
    out.put("B", 0)  # mesh_use_embedded_materials
