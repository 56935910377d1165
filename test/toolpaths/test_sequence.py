# SPDX-License-Identifier: Apache-2.0
"""The order of passes against every order there is."""

from itertools import permutations, product

import numpy as np
import pytest

from vega_planner.toolpaths.linking import Pass
from vega_planner.toolpaths.sequence import shortest_sequence


def _passes(seed, count):
    draw = np.random.default_rng(seed)
    return [Pass(draw.uniform(0, 50, (4, 12)), False) for _ in range(count)]


def _way(passes, sequence, at):
    total = 0.0
    for n, backwards in sequence:
        rows = passes[n].rows[:, :3]
        rows = rows[::-1] if backwards else rows
        total += 0.0 if at is None else np.linalg.norm(rows[0] - at)
        at = rows[-1]
    return total


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("start", [None, np.array([25.0, 0.0, 0.0])])
def test_no_other_order_or_direction_is_shorter(seed, start):
    passes = _passes(seed, 4)
    found = shortest_sequence(passes, start)
    assert sorted(n for n, _ in found) == [0, 1, 2, 3]
    least = min(
        _way(passes, list(zip(order, turns)), start)
        for order in permutations(range(4))
        for turns in product((False, True), repeat=4)
    )
    assert _way(passes, found, start) == pytest.approx(least)


def test_every_one_of_many_passes_has_its_turn():
    found = shortest_sequence(_passes(1, 30), np.zeros(3))
    assert sorted(n for n, _ in found) == list(range(30))
    assert shortest_sequence([], None) == []
