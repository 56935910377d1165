# SPDX-License-Identifier: Apache-2.0
"""Which way the core is filled: others are tried while the aims are missed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from vega_planner.datatypes import Part
from vega_planner.layers.core import Core
from vega_planner.layers.coverage import Samples, spread_samples
from vega_planner.layers.filling import Filling, fill_pockets

#: Points that tell how well a small part is filled where more than this share stays open.
CLOSE_SAMPLES, NEAR_RATIO = 150000, 0.0032

#: Deeper pieces move, at last, as soon as this share of them has no room of t.
LITTLE_SHARE = 0.1


def best_filling(
    part: Part,
    samples: Samples,
    core: Callable[..., Core],
    fill: Callable[[list[Core], Samples], Filling],
    t: float,
    small: bool,
    is_final: Callable[[Filling], bool],
) -> Filling:
    """Fill a part in one way after another until the aims are met.

    The more pieces of levels move into the core, the fewer envelopes are left, so ways in
    which more of them move come last, and none in which whole levels do that did not at
    first. At the end sheets grow towards what all ways leave open.

    Args:
        part: The part.
        samples: Points of the part.
        core: Makes the core; takes the choices of `fill_core`.
        fill: Fills what given ways to make the core leave open, by given points.
        t: Layer thickness [mm].
        small: Whether the part is small enough to be asked at many points.
        is_final: Whether the first filling stands; else a closer grid follows anyhow, and
            no other way is tried.

    Returns:
        The best filling found.
    """

    def ways(**choices: Any) -> list[Core]:
        made = [core(**choices)]
        if made[0].begins_early:
            # Keeping all levels as they are costs less than it gains where walls vary.
            made.append(core(staying_ratio=1.0, **choices))
        return made

    first = ways()
    filling = fill(first, samples)
    if small and filling.uncovered > NEAR_RATIO:
        samples = spread_samples(part, CLOSE_SAMPLES)
        filling = filling.measured(part, samples)
    if not filling.missed or not is_final(filling):
        return filling
    others: list[Callable[[], list[Core]]] = [
        lambda: first[:1],
        lambda: ways(carried=False),
        lambda: [core(staying_ratio=0.0)],
        lambda: [core(moving_share=LITTLE_SHARE)],
    ]
    known, tried = [first], [filling]
    for other in others:
        cores = other()
        leaves_early = cores[0].begins_early and not first[0].begins_early
        if leaves_early or any(_alike(cores, before) for before in known):
            continue
        known.append(cores)
        tried.append(fill(cores, samples))
        if not tried[-1].missed:
            break
    best = min(tried, key=lambda way: way.rank)
    if not best.missed:
        return best
    even = min((way.even or way for way in tried), key=lambda way: way.hope)
    grown = fill_pockets(part, samples, even.measured(part, samples), t)
    return min(best, grown, key=lambda way: way.rank)


def _alike(cores: list[Core], others: list[Core]) -> bool:
    same = len(cores) == len(others)
    return same and all(core.is_like(other) for core, other in zip(cores, others))
