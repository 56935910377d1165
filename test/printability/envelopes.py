# SPDX-License-Identifier: Apache-2.0
"""Parts whose enveloping layers are known exactly, and a cell around them."""

from __future__ import annotations

from functools import cache

import numpy as np
import trimesh

from vega_planner.datatypes import Layer, LayerStack, Part
from vega_planner.robot.workcell import Workcell, load_cell
from vega_planner.settings import CellSettings


def dome_sheet(radius: float, rings: int) -> tuple[np.ndarray, np.ndarray]:
    """An open half sphere over z = 0, normals outward."""
    around = 4 * rings
    tilt = np.linspace(0, np.pi / 2, rings + 1)[1:]
    turn = np.arange(around) * 2 * np.pi / around
    rows = [
        np.column_stack(
            [
                radius * np.sin(t) * np.cos(turn),
                radius * np.sin(t) * np.sin(turn),
                np.full(around, radius * np.cos(t)),
            ]
        )
        for t in tilt
    ]
    vertices = np.vstack([[[0.0, 0.0, radius]], *rows])
    vertices[np.abs(vertices) < 1e-12] = 0.0
    faces = [[0, 1 + j, 1 + (j + 1) % around] for j in range(around)]
    for i in range(rings - 1):
        a, b = 1 + i * around, 1 + (i + 1) * around
        for j in range(around):
            k = (j + 1) % around
            faces += [[a + j, b + j, b + k], [a + j, b + k, a + k]]
    return vertices, np.array(faces)


@cache
def dome(radius: float = 12.0, thickness: float = 0.8, edge: float = 1.2) -> LayerStack:
    """A half sphere standing flat, its base restrained."""
    rings = int(radius * 1.57 / edge)
    vertices, faces = dome_sheet(radius, rings)
    around = 4 * rings
    rim = np.arange(len(vertices) - around, len(vertices))
    centre = len(vertices)
    base = np.array([[centre, rim[(j + 1) % around], rim[j]] for j in range(around)])
    part = Part(
        "dome",
        np.vstack([vertices, [[0.0, 0.0, 0.0]]]),
        np.vstack([faces, base]),
        np.r_[np.zeros(len(faces), bool), np.ones(around, bool)],
        ("down",),
    )
    layers = []
    depth = 0.5 * thickness
    while radius - depth > 0.3:
        inner = radius - depth
        v, f = dome_sheet(inner, max(4, int(inner * 1.57 / edge)))
        layers.append(
            Layer(len(layers), "envelope", depth, v, f, np.full(len(v), thickness))
        )
        depth += thickness
    return LayerStack(part, "field", thickness, tuple(layers))


@cache
def ellipsoid(
    a: float = 13.0, b: float = 11.0, c: float = 10.0, thickness: float = 0.8, fine: int = 4
) -> LayerStack:
    """A closed ellipsoid that touches z = 0 in one point."""
    ball = trimesh.creation.icosphere(fine)
    v, f = np.array(ball.vertices), np.array(ball.faces)
    part = Part("ellipsoid", v * [a, b, c] + [0, 0, c], f, np.zeros(len(f), bool))
    layers = []
    depth = 0.5 * thickness
    while min(a, b, c) - depth > 1.5:
        shell = v * [a - depth, b - depth, c - depth] + [0, 0, c]
        layers.append(
            Layer(len(layers), "envelope", depth, shell, f, np.full(len(v), thickness))
        )
        depth += thickness
    return LayerStack(part, "field", thickness, tuple(layers))


@cache
def default_cell() -> Workcell:
    """The default robot, tool and material, the part in the middle of the plate."""
    return load_cell(CellSettings())
