# SPDX-License-Identifier: Apache-2.0
"""Layers in the scene, one node each, with the faces that cannot be printed in colour."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from vega_planner.datatypes import REASON_CODES, Floats, Ints, Layer, TriangleGeometry
from vega_planner.units import mm_to_m
from vega_planner.viewer.colours import REASON_COLOURS, layer_colour
from vega_planner.viewer.glb import baked_colours, triangles_glb
from vega_planner.viewer.level_of_detail import clustered
from vega_planner.viewer.result_folder import coloured_submesh
from vega_planner.viewer.section import Cut, clipped

#: Faces of all layers together that software rendering draws a few times a second.
LIGHT_BUDGET = 36_000


class LayerView:
    """The layers of a plan in a viser scene."""

    def __init__(self, scene: Any) -> None:
        """Start with no layers."""
        self._scene = scene
        self._nodes: dict[int, Any] = {}
        self._marks: dict[int, list[Any]] = {}
        self._visible: dict[int, bool] = {}

    def clear(self) -> None:
        """Take all layers out of the scene."""
        for node in [*self._nodes.values(), *(m for marks in self._marks.values() for m in marks)]:
            node.remove()
        self._nodes, self._marks, self._visible = {}, {}, {}

    def show(
        self,
        sheets: Sequence[Layer],
        reasons: Sequence[Ints],
        *,
        full_detail: bool = False,
        cut: Cut | None = None,
    ) -> None:
        """Draw layers.

        Args:
            sheets: The layers.
            reasons: Per sheet 0 where a face is printable, else 1 + index into
                `REASON_CODES`, shape (m,).
            full_detail: Draw every face, however many there are.
            cut: Where they are cut open.
        """
        self.clear()
        total = max(sum(len(sheet.faces) for sheet in sheets), 1)
        for sheet, reason in zip(sheets, reasons, strict=True):
            share = max(int(LIGHT_BUDGET * len(sheet.faces) / total), 200)
            budget = len(sheet.faces) if full_detail else share
            self._add(sheet, len(sheets), budget, cut)
            self._mark(sheet, reason, cut)

    def set_visible(self, wanted: set[int]) -> None:
        """Show these layers and hide the others; what is so already is left alone."""
        for index, node in self._nodes.items():
            visible = index in wanted
            if self._visible.get(index, True) != visible:
                self._visible[index] = visible
                node.visible = visible
                for mark in self._marks[index]:
                    mark.visible = visible

    def _add(self, sheet: Layer, count: int, budget: int, cut: Cut | None) -> None:
        self._marks[sheet.index] = []
        # Coarser first: cut afterwards, the edge stays straight.
        coarse = clustered(sheet.vertices, sheet.faces, budget)
        vertices, faces = clipped(*coarse, cut)
        if not len(faces):
            return
        used, flat = np.unique(faces, return_inverse=True)
        vertices, faces = vertices[used], flat.reshape(-1, 3)
        normals = _Surface(vertices, faces).vertex_normals
        colours = baked_colours(normals, layer_colour(sheet.index, count))
        self._nodes[sheet.index] = self._scene.add_glb(
            f"/layers/{sheet.index:03d}",
            triangles_glb(mm_to_m(vertices), faces, colours),
            cast_shadow=False,
            receive_shadow=False,
        )

    def _mark(self, sheet: Layer, reason: Ints, cut: Cut | None) -> None:
        for code in np.unique(reason[reason > 0]):
            marked = coloured_submesh(sheet, reason == code, 0.1)
            vertices, faces = clipped(*marked, cut)
            if not len(faces):
                continue
            reason_name = REASON_CODES[code - 1]
            colours = np.tile(REASON_COLOURS[reason_name], (len(vertices), 1))
            name = f"/unprintable/{sheet.index:03d}/{reason_name}"
            glb = triangles_glb(mm_to_m(vertices), faces, colours)
            node = self._scene.add_glb(name, glb, cast_shadow=False, receive_shadow=False)
            self._marks[sheet.index].append(node)


class _Surface(TriangleGeometry):
    """A mesh that is only drawn."""

    def __init__(self, vertices: Floats, faces: Ints) -> None:
        self.vertices, self.faces = vertices, faces
