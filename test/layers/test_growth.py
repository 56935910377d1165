# SPDX-License-Identifier: Apache-2.0
"""Sheets grow towards open pockets, there alone, and only as far as it pays."""

from __future__ import annotations

import numpy as np
import pytest

from vega_planner.datatypes import Layer
from vega_planner.layers.growth import MOST_RATIO, Gaps, Patches

T, WIDTH = 0.8, 12.0
SPACING = 0.1


def plane(height: float, count: int = 49) -> Layer:
    """A square sheet of thickness T at a height."""
    steps = np.linspace(0, WIDTH, count)
    x, y = np.meshgrid(steps, steps, indexing="ij")
    vertices = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, height)])
    corner = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).ravel()
    ahead, beside = corner + count, corner + 1
    faces = np.concatenate(
        [np.column_stack([corner, ahead, beside]), np.column_stack([beside, ahead, ahead + 1])]
    )
    return Layer(
        index=0, kind="core", depth_mm=height, vertices=vertices, faces=faces,
        thickness=np.full(len(vertices), T),
    )  # fmt: skip


def pocket(low: list[float], high: list[float]) -> np.ndarray:
    axes = [np.arange(a + SPACING / 2, b, SPACING) for a, b in zip(low, high)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)


def grown(sheets: list[Layer], points: np.ndarray, weight: float) -> tuple[Layer, ...]:
    return Gaps.between(sheets, points, SPACING**3, T).filled(sheets, weight, T)


def test_a_sheet_grows_as_far_as_a_wide_pocket_is_deep():
    # 0.1 mm on one side: each side's growth lays as much on the other one.
    points = pocket([3, 3, T / 2], [9, 9, T / 2 + 0.1])
    (sheet,) = grown([plane(0.0)], points, 4.0)
    inside = (np.abs(sheet.vertices[:, :2] - WIDTH / 2) < 2).all(1)
    assert (sheet.thickness[inside] / 2 >= T / 2 + SPACING / 2).all()
    assert (sheet.thickness[inside] / 2 < T / 2 + 0.15).all()


def test_it_does_not_grow_where_covering_costs_more_than_it_is_worth():
    points = pocket([3, 3, T / 2], [9, 9, T / 2 + 0.1])
    (sheet,) = grown([plane(0.0)], points, 0.9)
    assert (sheet.thickness == T).all()


def test_pockets_on_both_sides_are_worth_it_sooner_than_one():
    points = pocket([3, 3, T / 2], [9, 9, T / 2 + 0.1])
    points = np.concatenate([points, points * [1, 1, -1]])
    (sheet,) = grown([plane(0.0)], points, 0.9)
    inside = (np.abs(sheet.vertices[:, :2] - WIDTH / 2) < 2).all(1)
    assert (sheet.thickness[inside] > T + SPACING / 2).all()


def test_far_from_a_pocket_nothing_changes():
    points = pocket([3, 3, T / 2], [5, 5, T / 2 + 0.2])
    sheets = [plane(0.0), plane(T + 0.2)]
    for before, after in zip(sheets, grown(sheets, points, 6.0)):
        far = (np.abs(after.vertices[:, :2] - 4) > 1 + 4 * T).any(1)
        assert (after.thickness[far] == before.thickness[far]).all()
        assert (after.vertices == before.vertices).all()


def test_no_sheet_gets_thinner_or_thicker_than_beads_can_be():
    points = pocket([3, 3, T / 2], [9, 9, 1.15])
    (sheet,) = grown([plane(0.0)], points, 100.0)
    assert (sheet.thickness >= T).all()
    assert sheet.thickness.max() == pytest.approx(MOST_RATIO * T)


def test_points_belong_to_the_sheet_that_has_least_to_grow():
    points = pocket([3, 3, T / 2], [9, 9, T / 2 + 0.1])
    near, far = grown([plane(0.0), plane(T + 0.3)], points, 4.0)
    assert (near.thickness > T).any()
    assert (far.thickness == T).all()


def test_patches_divide_a_sheet_into_cubes_of_their_width():
    sheet = plane(0.3)
    patches = Patches.of_sheet(sheet, 0.5)
    middles = sheet.vertices[sheet.faces].mean(1)
    for number in (0, patches.count // 2, patches.count - 1):
        assert (np.ptp(middles[patches.of_face == number], axis=0) < 0.5).all()
    assert patches.count == 24 * 24
    # A square of 24 by 24 has 2 * 24 * 23 sides between its cells.
    assert len(patches.beside) == 2 * 24 * 23


def test_what_is_spread_goes_to_the_neighbours_on_both_sides():
    patches = Patches(np.arange(3), 3, np.array([[0, 1], [1, 2]]))
    assert patches.spread(np.array([0.0, 2.0, 0.0])).tolist() == [1.0, 2.0, 1.0]


def test_only_three_rings_of_patches_about_some_are_kept():
    chain = Patches(np.arange(9), 9, np.column_stack([np.arange(8), np.arange(1, 9)]))
    kept = chain.about(np.array([0]))
    assert kept.of_face.tolist() == [0, 1, 2, 3, -1, -1, -1, -1, -1]
    assert kept.beside.tolist() == [[0, 1], [1, 2], [2, 3]]
