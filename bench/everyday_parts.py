# SPDX-License-Identifier: Apache-2.0
"""Parts as people print them, drawn by code."""

from __future__ import annotations

from collections.abc import Callable

import manifold3d
import numpy as np

Solid = manifold3d.Manifold
Outline = manifold3d.CrossSection


def cylinder(height: float, radius: float, sides: int = 64) -> Solid:
    return Solid.cylinder(height, radius, radius, sides)


def prism(points: list[tuple[float, float]], height: float) -> Solid:
    return Solid.extrude(Outline([np.array(points)]), height)


def mug() -> Solid:
    body = cylinder(40, 16, 96) - cylinder(40, 13, 96).translate((0, 0, 3))
    handle = Solid.revolve(Outline.circle(2.5, 32).translate((11, 0)), 64).rotate((90, 0, 0))
    return body + (handle.translate((16, 0, 20)) - cylinder(40, 14, 96))


def bracket() -> Solid:
    solid = Solid.cube((40, 20, 5)) + Solid.cube((5, 20, 35))
    gusset = prism([(5, 5), (25, 5), (5, 25)], 4).rotate((90, 0, 0))
    solid += gusset.translate((0, 12, 0))
    for x in (18, 33):
        for y in (5, 15):
            solid -= cylinder(7, 2.5).translate((x, y, -1))
    return solid - cylinder(7, 3).rotate((0, 90, 0)).translate((-1, 10, 27))


def impeller() -> Solid:
    solid = cylinder(4, 20, 96) + cylinder(15, 5)
    blade = Solid.cube((15, 2.2, 10)).translate((4, -1.1, 3))
    for k in range(7):
        solid += blade.rotate((0, 0, 360 * k / 7))
    return solid


def perforated() -> Solid:
    solid = Solid.cube((50, 40, 4))
    for i in range(5):
        for j in range(4):
            solid -= cylinder(6, 2.5 + 0.3 * i, 32).translate((7 + 9 * i, 6 + 9 * j, -1))
    return solid


def ribbed() -> Solid:
    solid = Solid.cube((50, 50, 2))
    for k in range(4):
        solid += Solid.cube((2, 50, 8)).translate((3 + 14 * k, 0, 1.9))
        solid += Solid.cube((50, 2, 8)).translate((0, 3 + 14 * k, 1.9))
    return solid


def pins() -> Solid:
    solid = Solid.cube((40, 30, 4))
    for i in range(5):
        for j in range(4):
            pin = cylinder(12, 1.5 + 0.2 * i, 24)
            solid += pin.translate((4 + 8 * i, 4 + 7.3 * j, 3.9))
    return solid


def gyroid() -> Solid:
    def inside(x: float, y: float, z: float) -> float:
        a, b, c = x / 4, y / 4, z / 4
        wave = np.sin(a) * np.cos(b) + np.sin(b) * np.cos(c) + np.sin(c) * np.cos(a)
        return float(0.45 - abs(wave))

    return Solid.level_set(inside, [-18, -18, 0, 18, 18, 30], 1.0)


def twisted() -> Solid:
    return Solid.extrude(Outline.square((20, 20), True), 40, 60, 90)


def blade() -> Solid:
    """It tapers to an edge from both sides: its last layers end everywhere."""
    return prism([(0, 0), (6, 0), (3, 30)], 30).rotate((90, 0, 0))


def honeycomb() -> Solid:
    """Webs of all widths between 0.8 mm and 3 mm."""
    solid = Solid.cube((45, 40, 8))
    for i in range(5):
        for j in range(5):
            x, y = 6 + 8 * i + (4 if j % 2 else 0), 5 + 7.2 * j
            solid -= cylinder(10, 3.6, 6).translate((x, y, -1))
    return solid


SOLIDS: dict[str, Callable[[], Solid]] = {
    solid.__name__: solid
    for solid in (
        mug, bracket, impeller, perforated, ribbed, pins, gyroid, twisted, blade, honeycomb,
    )
}  # fmt: skip
