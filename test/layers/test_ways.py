# SPDX-License-Identifier: Apache-2.0
"""Ways to fill the core are tried until one meets the aims, and none twice."""

from __future__ import annotations

import numpy as np
import pytest
from manifold3d import Manifold as Solid

from vega_planner.layers import generate_layers
from vega_planner.layers.core import Core
from vega_planner.layers.coverage import Coverage, spread_samples
from vega_planner.layers.filling import Filling
from vega_planner.layers.ways import best_filling
from vega_planner.settings import LayerSettings

from .shapes import box, part_of


class Tries:
    """Makes cores that differ by what is kept, and notes which are filled."""

    def __init__(self, begins_early: bool, overfills: list[float]) -> None:
        self.begins_early, self.overfills = begins_early, list(overfills)
        self.filled: list[list[dict]] = []
        self.choices: dict[int, dict] = {}
        self.cores: list[Core] = []

    def core(self, **choices) -> Core:
        stays = choices.get("staying_ratio", 0.006)
        whole = not self.begins_early or stays == 1.0
        moved = 1 if choices.get("moving_share") else 0
        kept = (np.full(3, whole), np.ones(3, bool), np.arange(3) >= moved)
        core = Core((), (np.full(3, 0.8 - (choices.get("carried") is False)),) * 3, kept)
        self.choices[id(core)] = choices
        self.cores.append(core)  # or another one might get its number
        return core

    def fill(self, cores: list[Core], samples) -> Filling:
        self.filled.append([self.choices[id(core)] for core in cores])
        none = np.zeros(0, np.int64)
        return Filling((), (), Coverage(0.001, self.overfills.pop(0), none))


@pytest.mark.parametrize(
    ("early", "overfills", "filled"),
    [
        (False, [0.01], [[{}]]),
        (True, [0.01], [[{}, {"staying_ratio": 1.0}]]),
        (True, [0.03, 0.01], [[{}, {"staying_ratio": 1.0}], [{}]]),
        (
            False, [0.03, 0.03, 0.01],
            [[{}], [{"carried": False}], [{"moving_share": 0.1}]],
        ),
    ],
)  # fmt: skip
def test_the_first_way_that_meets_the_aims_is_taken(early, overfills, filled):
    part, tries = box(8, 6, 4), Tries(early, overfills)
    best = best_filling(
        part, spread_samples(part), tries.core, tries.fill, 0.8, False, lambda _: True
    )
    assert tries.filled == filled
    assert best.overfill == overfills[-1]


def test_an_angle_with_walls_of_six_layers_and_a_bit_is_not_laid_twice():
    """Its last level does harm if it stays, and as a whole moves to where it has room."""
    solid = Solid.cube((40, 20, 5)) + Solid.cube((5, 20, 35))
    gusset = Solid.cube((20, 4, 20)).rotate((0, 45, 0)).translate((5, 8, 19.2))
    solid += gusset ^ Solid.cube((40, 20, 35))
    for x in (18, 33):
        solid -= Solid.cylinder(7, 2.5, 2.5, 64).translate((x, 5, -1))
    stack = generate_layers(part_of(solid), LayerSettings(thickness_mm=0.8))
    assert stack.uncovered_ratio <= 0.005
    assert stack.overfill_ratio <= 0.02
