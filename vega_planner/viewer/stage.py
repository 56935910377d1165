# SPDX-License-Identifier: Apache-2.0
"""Light, camera and the part itself.

The scene's frame is the part frame in metres, so that the part stays where it is while
robot and cell are put round it. Nothing is lit: shade is baked into the colours, since a
renderer without a graphics card draws plain colours many times as fast.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints, TriangleGeometry
from vega_planner.units import mm_to_m
from vega_planner.viewer.glb import lines_glb, shaded_glb
from vega_planner.viewer.level_of_detail import clustered
from vega_planner.viewer.result_folder import coloured_submesh

PART_COLOUR = (158, 170, 184)
REGION_COLOUR = (235, 120, 30)
GRID_COLOUR = (150, 160, 172)
#: Distance of the lines of the grid below the part [mm].
GRID_MM = 10.0
#: Faces of the part that are drawn at most; picking uses all of them.
PART_BUDGET = 40_000


class Stage:
    """The part and its restraint region in a viser scene."""

    def __init__(self, server: Any) -> None:
        """Set up light and an empty scene."""
        self._server = server
        self._scene = server.scene
        self._scene.set_up_direction("+z")
        self._scene.configure_default_lights(False, cast_shadow=False)
        self._scene.configure_environment_map(None)
        self._part: Any = None
        self._region: Any = None
        self._grid: Any = None
        self._drawn: tuple[Floats, Ints] | None = None
        self._ghost = False

    def show_part(self, part: TriangleGeometry) -> None:
        """Draw a part and point the camera of whoever comes next at it."""
        vertices, faces = clustered(part.vertices, part.faces, PART_BUDGET)
        self._drawn = vertices, faces
        self._ghost = False
        self._part = self._add("/part", vertices, faces, PART_COLOUR)
        self._grid = self._scene.add_glb(
            "/grid", grid_glb(part.vertices), cast_shadow=False, receive_shadow=False
        )
        position, target = viewpoint(part.vertices)
        self._server.initial_camera.position = tuple(position)
        self._server.initial_camera.look_at = tuple(target)
        for client in self._server.get_clients().values():
            client.camera.position = position
            client.camera.look_at = target

    def show_region(self, part: TriangleGeometry, chosen: Bools) -> None:
        """Colour the chosen faces, shape (m,)."""
        if self._region is not None:
            self._region.remove()
            self._region = None
        if chosen.any():
            lift = 2e-3 * float(np.ptp(part.vertices, axis=0).max())
            vertices, faces = coloured_submesh(part, chosen, lift)
            self._region = self._add("/restraint", vertices, faces, REGION_COLOUR, contrast=0.35)

    def set_visible(
        self, part: bool, region: bool, *, grid: bool = True, ghost: bool = False
    ) -> None:
        """Show or hide the part, its restraint region and the grid below.

        Args:
            part: Whether the part is shown.
            region: Whether its restraint region is.
            grid: Whether the grid is; a build plate takes its place.
            ghost: Whether the part lets layers shine through.
        """
        if self._drawn is not None and ghost != self._ghost:
            self._ghost = ghost
            self._part = self._add("/part", *self._drawn, PART_COLOUR, 0.3 if ghost else 1.0)
        for handle, visible in (
            (self._part, part),
            (self._region, region),
            (self._grid, grid),
        ):
            if handle is not None and handle.visible != visible:
                handle.visible = visible

    def _add(
        self,
        name: str,
        vertices: Floats,
        faces: Ints,
        colour: tuple[int, int, int],
        opacity: float = 1.0,
        contrast: float = 1.0,
    ) -> Any:
        glb = shaded_glb(mm_to_m(vertices), faces, colour, opacity, contrast)
        return self._scene.add_glb(name, glb, cast_shadow=False, receive_shadow=False)


def grid_glb(vertices: Floats) -> bytes:
    """Draw a grid that a part stands on, somewhat larger than the part.

    It lies a little below the part and what colours its underside.
    """
    height = vertices[:, 2].min() - 5e-3 * float(np.ptp(vertices, axis=0).max())
    low = GRID_MM * (np.floor(vertices.min(0)[:2] / GRID_MM) - 1)
    high = GRID_MM * (np.ceil(vertices.max(0)[:2] / GRID_MM) + 1)
    ends = []
    for axis in (0, 1):
        steps = np.linspace(low[axis], high[axis], round((high - low)[axis] / GRID_MM) + 1)
        for at in steps[:: 1 + len(steps) // 60]:
            for other in (low[1 - axis], high[1 - axis]):
                point = [other, other, height]
                point[axis] = at
                ends.append(point)
    points = mm_to_m(np.array(ends))
    colours = np.tile(np.array(GRID_COLOUR, np.uint8), (len(points), 1))
    return lines_glb(points, np.arange(len(points)).reshape(-1, 2), colours)


def viewpoint(vertices: Floats) -> tuple[Floats, Floats]:
    """Choose a camera position and what it looks at [m] for points [mm]."""
    low, high = mm_to_m(vertices.min(0)), mm_to_m(vertices.max(0))
    target = (low + high) / 2
    size = float(np.linalg.norm(high - low))
    return target + 1.05 * size * np.array([0.5, -0.75, 0.45]), target
