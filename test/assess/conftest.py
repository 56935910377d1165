# SPDX-License-Identifier: Apache-2.0
"""Shapes and ideal toolpaths the tests of this room share."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from vega_planner.assess.beads import BeadRows
from vega_planner.datatypes import Part

THICKNESS, WIDTH = 0.8, 1.2
#: Distance of beads at which a stadium's area fills its layer: area / height.
SPACING = 1.028


def round_part(radius: float, top: float, rings: int = 48, sides: int = 120, name="round"):
    """A body of revolution: polar angles from 0 (equator) to `top` above, flat below."""
    angles = np.linspace(0, top, rings + 1)[:-1]
    turn = 2 * np.pi * np.arange(sides) / sides
    ring = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(sides)])
    vertices = np.concatenate(
        [radius * (np.cos(a) * ring + [0, 0, np.sin(a)]) for a in angles]
        + [[[0, 0, radius]], [[0, 0, 0]]]
    )
    faces = []
    here = np.arange(sides)
    there = (here + 1) % sides
    for k in range(rings - 1):
        a, b = here + k * sides, there + k * sides
        faces += [np.column_stack([a, b, b + sides]), np.column_stack([a, b + sides, a + sides])]
    last = (rings - 1) * sides
    pole, middle = np.full(sides, len(vertices) - 2), np.full(sides, len(vertices) - 1)
    faces += [np.column_stack([here + last, there + last, pole])]
    faces += [np.column_stack([there, here, middle])]
    faces = np.concatenate(faces)
    return Part(name, vertices, faces, np.arange(len(faces)) >= len(faces) - sides, ("down",))


def rows_of(paths) -> BeadRows:
    """Put passes, each (points, axes), together."""
    counts = [len(points) for points, _ in paths]
    total = sum(counts)
    return BeadRows(
        path_id=np.repeat(np.arange(len(paths)), counts),
        points=np.concatenate([points for points, _ in paths]),
        axes=np.concatenate([axes for _, axes in paths]),
        width=np.full(total, WIDTH),
        height=np.full(total, THICKNESS),
        extrude=np.concatenate([np.arange(count) > 0 for count in counts]),
    )


def line(start, end, axis=(0.0, 0.0, 1.0), count=2):
    """A straight pass."""
    return np.linspace(start, end, count), np.tile(axis, (count, 1))


def block(size=(10.0, 3.0, 3.0)) -> Part:
    """A block that stands on its restrained base."""
    x, y, z = size
    corners = [[i, j, k] for k in (0, z) for j in (-y / 2, y / 2) for i in (-x / 2, x / 2)]
    faces = np.array(
        [[0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6], [0, 1, 4], [1, 5, 4],
         [2, 6, 3], [3, 6, 7], [0, 4, 2], [2, 4, 6], [1, 3, 5], [3, 7, 5]]
    )  # fmt: skip
    return Part("block", corners, faces, np.isin(np.arange(12), [0, 1]), ("down",))


def _loop(radius: float, z: float):
    turn = np.linspace(0, 2 * np.pi, max(12, int(2 * np.pi * radius / 0.4)) + 1)
    return np.column_stack([radius * np.cos(turn), radius * np.sin(turn), np.full(len(turn), z)])


def planar_dome(radius: float) -> BeadRows:
    """Flat layers of concentric loops in a hemisphere."""
    paths = []
    for z in np.arange(THICKNESS / 2, radius, THICKNESS):
        reach = np.sqrt(radius**2 - z**2) - SPACING / 2
        while reach > 0.25 * SPACING:
            points = _loop(reach, z)
            paths.append((points, np.tile([0.0, 0.0, 1.0], (len(points), 1))))
            reach -= SPACING
    return rows_of(paths)


def enveloping_dome(radius: float) -> BeadRows:
    """Nested hemispherical shells of loops, from the inside out."""
    paths = []
    for shell in np.arange(radius - THICKNESS / 2, 0, -THICKNESS)[::-1]:
        arc = SPACING / 2
        while arc < shell * np.pi / 2 - 0.25 * SPACING:
            points = _loop(shell * np.cos(arc / shell), shell * np.sin(arc / shell))
            paths.append((points, points / shell))
            arc += SPACING
    return rows_of(paths)


@pytest.fixture(scope="session")
def dome() -> Part:
    """Hemisphere of 40 mm diameter on its flat, restrained base."""
    return round_part(20.0, np.pi / 2, 64, 160, "dome")


@pytest.fixture(scope="session")
def small_dome() -> Part:
    return round_part(8.0, np.pi / 2, 48, 120, "small")


@pytest.fixture(scope="session")
def ideal() -> SimpleNamespace:
    """Makers of parts and of perfect toolpaths."""
    return SimpleNamespace(
        planar_dome=planar_dome,
        enveloping_dome=enveloping_dome,
        round_part=round_part,
        rows_of=rows_of,
        block=block,
        line=line,
        thickness=THICKNESS,
        width=WIDTH,
    )
