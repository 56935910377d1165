# SPDX-License-Identifier: Apache-2.0
"""The toolpath in the scene, in pieces that are shown as time passes.

A piece is one draw call of thin lines; the piece being printed is drawn again as far
as it has come. Only pieces whose state changes are told to the browser.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vega_planner.datatypes import Floats, Ints
from vega_planner.units import mm_to_m
from vega_planner.viewer.colours import layer_colour, speed_colours
from vega_planner.viewer.glb import lines_glb
from vega_planner.viewer.level_of_detail import kept_rows
from vega_planner.viewer.section import Cut
from vega_planner.viewer.timeline import Moment, Timeline

#: Points that are drawn in software rendering.
LIGHT_BUDGET = 40_000
#: How far lines are lifted off the layer they lie in, towards the nozzle [mm].
LIFT_MM = 0.15
#: Segments of one piece.
PIECE = 512
BY_LAYER, BY_SPEED = COLOURINGS = ("layer", "speed")


@dataclass(frozen=True, eq=False)
class Piece:
    """Consecutive segments of one layer.

    Attributes:
        layer: The layer.
        starts: Row of the toolpath at which each segment begins, shape (k,).
        ends: Row at which it ends, rising, shape (k,).
    """

    layer: int
    starts: Ints
    ends: Ints


def cut_into_pieces(timeline: Timeline, budget: int) -> list[Piece]:
    """Thin a toolpath for display and cut its beads into pieces, in print order."""
    count = len(timeline.points)
    new_pass = np.ones(count + 1, dtype=bool)
    new_pass[1:-1] = timeline.path_id[1:] != timeline.path_id[:-1]
    printing = np.flatnonzero(timeline.path_id >= 0)
    if not len(printing):
        return []
    ends = (new_pass[:-1] | new_pass[1:])[printing]
    rows = printing[kept_rows(timeline.points[printing], ends, budget)]
    joined = timeline.path_id[rows[1:]] == timeline.path_id[rows[:-1]]
    starts, stops = rows[:-1][joined], rows[1:][joined]
    layers = timeline.layer[stops]
    breaks = np.flatnonzero(np.diff(layers)) + 1
    pieces = []
    for first, last in zip([0, *breaks], [*breaks, len(stops)], strict=True):
        for begin in range(first, last, PIECE):
            part = slice(begin, min(begin + PIECE, last))
            pieces.append(Piece(int(layers[begin]), starts[part], stops[part]))
    return pieces


class PathView:
    """A toolpath in a viser scene."""

    def __init__(self, scene: Any) -> None:
        """Start with no toolpath."""
        self._scene = scene
        self._timeline: Timeline | None = None
        self._pieces: list[Piece] = []
        self._nodes: list[Any] = []
        self._visible: NDArray[np.bool_] = np.zeros(0, dtype=bool)
        self._colours: NDArray[np.uint8] = np.zeros((0, 3), dtype=np.uint8)
        self._growing: Any = None
        self._last_ends: Ints = np.zeros(0, dtype=np.int64)

    def clear(self) -> None:
        """Take the toolpath out of the scene."""
        for node in self._nodes:
            node.remove()
        if self._growing is not None:
            self._growing.remove()
            self._growing = None
        self._nodes, self._pieces, self._timeline = [], [], None

    def show(
        self,
        timeline: Timeline,
        layer_count: int,
        *,
        speeds: Floats | None = None,
        full_detail: bool = False,
        cut: Cut | None = None,
    ) -> None:
        """Draw a toolpath, all of it hidden until `set_time`.

        Args:
            timeline: The toolpath.
            layer_count: Number of layers, for the colours.
            speeds: Speed of the tip at each row, shape (n,), to colour by; by layer when
                absent.
            full_detail: Draw every point.
            cut: Where it is cut open, as the layers are.
        """
        self.clear()
        self._timeline = timeline
        budget = len(timeline.points) if full_detail else LIGHT_BUDGET
        self._pieces = [
            piece
            for whole in cut_into_pieces(timeline, budget)
            if len((piece := _this_side(whole, timeline, cut)).ends)
        ]
        self._colours = _colours(timeline, layer_count, speeds)
        self._last_ends = np.array([piece.ends[-1] for piece in self._pieces], dtype=np.int64)
        for index, piece in enumerate(self._pieces):
            rows = np.concatenate([piece.starts, piece.ends])
            used, flat = np.unique(rows, return_inverse=True)
            lifted = timeline.points[used] + LIFT_MM * timeline.axes[used]
            glb = lines_glb(mm_to_m(lifted), flat.reshape(2, -1).T, self._colours[used])
            self._nodes.append(
                self._scene.add_glb(
                    f"/toolpath/{index:04d}",
                    glb,
                    visible=False,
                    cast_shadow=False,
                    receive_shadow=False,
                )
            )
        self._visible = np.zeros(len(self._pieces), dtype=bool)

    def set_time(self, moment: Moment, layers: set[int]) -> None:
        """Show what is printed by now, of these layers."""
        if self._timeline is None:
            return
        done = self._last_ends <= moment.row
        wanted = done & np.array([piece.layer in layers for piece in self._pieces], dtype=bool)
        for index in np.flatnonzero(wanted != self._visible):
            self._nodes[index].visible = bool(wanted[index])
        self._visible = wanted
        current = int(np.count_nonzero(done))
        self._grow(current, moment, layers)

    def _grow(self, current: int, moment: Moment, layers: set[int]) -> None:
        timeline = self._timeline
        lines = np.zeros((0, 2, 3))
        if timeline is not None and current < len(self._pieces):
            piece = self._pieces[current]
            begun = piece.starts <= moment.row
            if begun.any() and piece.layer in layers:
                rows = np.column_stack([piece.starts, piece.ends])[begun]
                lines = timeline.points[rows] + LIFT_MM * timeline.axes[rows]
                if rows[-1, 1] > moment.row:
                    lines[-1, 1] = moment.tip
        if not len(lines):
            if self._growing is not None:
                self._growing.visible = False
            return
        points = mm_to_m(lines).astype(np.float32)
        colours = np.broadcast_to(np.array([255, 90, 20], dtype=np.uint8), points.shape).copy()
        if self._growing is None:
            self._growing = self._scene.add_line_segments(
                "/growing", points, colours, thickness=2.0, thickness_units="screen"
            )
            return
        self._growing.points = points
        self._growing.colors = colours
        self._growing.visible = True


def _this_side(piece: Piece, timeline: Timeline, cut: Cut | None) -> Piece:
    """The segments of a piece that a cut leaves."""
    if cut is None:
        return piece
    middles = (timeline.points[piece.starts] + timeline.points[piece.ends]) / 2
    kept = cut.beyond(middles) <= 0
    return Piece(piece.layer, piece.starts[kept], piece.ends[kept])


def _colours(timeline: Timeline, layer_count: int, speeds: Floats | None) -> NDArray[np.uint8]:
    if speeds is not None:
        return speed_colours(speeds, timeline.path_id >= 0)
    table = np.array([layer_colour(n, layer_count) for n in range(max(layer_count, 1))])
    # Darker than the sheets, so that beads stand out on their layer.
    return (0.4 * table[np.clip(timeline.layer, 0, len(table) - 1)]).astype(np.uint8)
