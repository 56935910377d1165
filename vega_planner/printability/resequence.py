# SPDX-License-Identifier: Apache-2.0
"""Print patches in bands of height, where their walls stand in the nozzle's way.

Passes that each climb a wall to its top may stand too close to each other for the nozzle.
Cut where they leave a band of a bead or two, and the bands printed from the lowest up,
nothing is ever much higher than what is printed. Within a band the patches keep their order.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from vega_planner.datatypes import Toolpath

#: Height of a band, in bead widths.
BAND_WIDTHS = 1.6

#: Shorter pieces stay with the one before [mm].
SHORTEST_MM = 2.5


def joined(pairs: Collection[tuple[int, int]]) -> list[tuple[int, int]]:
    """Join ranges of patches that overlap, the first and the last of each included."""
    found: list[tuple[int, int]] = []
    for low, high in sorted((min(pair), max(pair)) for pair in pairs):
        if found and low <= found[-1][1]:
            found[-1] = (found[-1][0], max(high, found[-1][1]))
        else:
            found.append((low, high))
    return found


def in_bands(passes: Sequence[Toolpath], ranges: Sequence[tuple[int, int]]) -> list[Toolpath]:
    """Cut the passes of some patches into bands of height and put the lowest first.

    Args:
        passes: Passes in print order, their patches rising.
        ranges: First and last patch of each group that is printed in common bands, rising;
            the other patches stay as they are.

    Returns:
        Passes in print order; together they deposit what they did before, but for the
        steps from one band to the next.
    """
    done: list[Toolpath] = []
    group: list[Toolpath] = []
    waiting = list(ranges)
    for path in passes:
        if waiting and path.patch > waiting[0][1]:
            done += _ordered(group, done)
            group = []
            waiting.pop(0)
        if waiting and path.patch >= waiting[0][0]:
            group.append(path)
        else:
            done.append(path)
    return done + _ordered(group, done)


def _ordered(group: list[Toolpath], done: list[Toolpath]) -> list[Toolpath]:
    if not group:
        return []
    low = min(float(path.points[:, 2].min()) for path in group)
    height = BAND_WIDTHS * float(np.median(np.concatenate([path.width for path in group])))
    waiting: list[tuple[tuple[int, int], Toolpath]] = []
    for path in group:
        waiting += [((band, path.patch), piece) for band, piece in _cut(path, low, height)]
    ordered: list[Toolpath] = []
    at = done[-1].points[-1] if done else group[0].points[0]
    while waiting:
        first = min(key for key, _ in waiting)
        near = [
            (float(np.linalg.norm(path.points[0] - at)), n)
            for n, (key, path) in enumerate(waiting)
            if key == first
        ]
        _, path = waiting.pop(min(near)[1])
        ordered.append(path)
        at = path.points[-1]
    return ordered


def _cut(path: Toolpath, low: float, height: float) -> list[tuple[int, Toolpath]]:
    """Cut a pass where it leaves a band for good; each piece with the number of its band."""
    z = path.points[:, 2]
    # where a pass comes down again later, it has not left the band yet
    lowest_after = np.minimum.accumulate(z[::-1])[::-1]
    band = np.floor((lowest_after - low) / height + 1e-6).astype(int)
    along = np.concatenate(
        [[0.0], np.cumsum(np.linalg.norm(np.diff(path.points, axis=0), axis=1))]
    )
    cuts, begin = [0], 0
    for k in range(1, len(z) - 1):
        long_enough = along[k] - along[begin] > SHORTEST_MM and along[-1] - along[k] > SHORTEST_MM
        if band[k] > band[begin] and long_enough:
            cuts.append(k)
            begin = k
    if len(cuts) == 1:
        return [(int(band[0]), path)]
    pieces = []
    for a, b in zip(cuts, [*cuts[1:], len(z) - 1]):
        run = slice(a, b + 1)
        piece = replace(
            path, points=path.points[run], axes=path.axes[run], width=path.width[run],
            height=path.height[run], closed=False,
        )  # fmt: skip
        pieces.append((int(band[a]), piece))
    return pieces
