# SPDX-License-Identifier: Apache-2.0
"""Which pieces of the envelope sheets leave them for the core, each as a whole."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints
from vega_planner.layers import core_kernels as kernels
from vega_planner.layers.distance_field import DistanceField
from vega_planner.layers.front import Front, face_middles
from vega_planner.layers.summits import low_pieces
from vega_planner.part.topology import connected_pieces

#: Walls up to twice this, in t, get one sheet on their mid-surface instead of two.
MIDDLE_RATIO = 0.64

#: Gaps from which the next level may fill them, and how near to that others are, in t.
NEXT_RATIOS, NEXT_NEAR_RATIO = (0.49, 0.47, 0.45), 0.0075

#: A connected piece of a sheet moves whole where this share of it has no room of t.
MOVING_SHARE = 0.3

#: The same behind a level that has moved as a whole: what is deeper is core anyway.
LEAST_SHARE = 0.02

#: A connected piece of which this share is a sliver is made anew, all of it if what else it
#: has is below this area, in t².
SLIVER_SHARE, BESIDE_RATIO = 0.8, 8.0

#: Pieces below this area, in t², are asked how far they rise over their level.
SMALL_RATIO = 2.7


@dataclass(frozen=True, eq=False)
class Pieces:
    """The connected pieces of a front.

    Attributes:
        piece: The piece each face belongs to, shape (m,).
        areas: Area of each piece [mm²], shape (k,).
        ending: Area of its faces behind which there is no room for a layer, nor for a good
            sheet between two fronts [mm²], shape (k,).
        thin: Area of those of them that are slivers [mm²], shape (k,).
        volume: What is left open or laid twice if no piece moves [mm³].
        next_from: Gap from which the next level fills it [mm].
    """

    piece: Ints
    areas: Floats
    ending: Floats
    thin: Floats
    volume: float
    next_from: float

    @classmethod
    def of_front(
        cls,
        front: Front,
        gap: Floats,
        opposed: Bools,
        areas: Floats,
        t: float,
        sliver: float,
        wide: float,
    ) -> Pieces:
        """Find the connected pieces of a front.

        Args:
            front: The front.
            gap: Gap behind each face [mm], shape (m,).
            opposed: Whether fronts meet there, shape (m,).
            areas: Areas of the faces [mm²], shape (m,).
            t: Layer thickness [mm].
            sliver: Half the width of a sliver [mm].
            wide: Half width of gaps from which they get a sheet of their own [mm].
        """
        piece, count = connected_pieces(len(front.vertices), front.faces)
        weights = np.zeros((3, count))
        most = next_from(gap, areas, t)
        volume = kernels.weigh_pieces(piece, areas, gap, opposed, t, most, sliver, wide, weights)
        return cls(piece, *weights, volume, most)


def next_from(gap: Floats, areas: Floats, t: float) -> float:
    """Choose the gap from which the next level fills it, where the fewest are about as wide.

    A last layer is at most 3/2 t thick. Where walls are all as thick as that, some faces
    would else be filled by it and their neighbours by the next level.

    Args:
        gap: Gap behind each face [mm], shape (m,).
        areas: Areas of the faces [mm²], shape (m,).
        t: Layer thickness [mm].

    Returns:
        The gap [mm].
    """
    near = NEXT_NEAR_RATIO * t
    crossed = [areas[np.abs(gap - ratio * t) < near].sum() for ratio in NEXT_RATIOS]
    return NEXT_RATIOS[int(np.argmin(crossed))] * t


def leaving_faces(
    fronts: Sequence[Front],
    gaps: Sequence[tuple[Floats, Bools]],
    all_areas: Sequence[Floats],
    pieces: Sequence[Pieces],
    t: float,
    sliver: float,
    budget: float,
    moving: bool,
    share: float,
    h: float,
    field: DistanceField,
    brr: DistanceField | None,
) -> list[tuple[Bools, Bools]]:
    """Choose the connected pieces of sheets that leave them, each as a whole.

    Where all pieces of a level would leave though a deeper one stays, the one that does
    the least harm stays too, as long as all such harm keeps within a budget.

    Args:
        fronts: The sheets with their rooms.
        gaps: Gap behind each of their faces.
        all_areas: Areas of their faces [mm²].
        pieces: Their connected pieces.
        t: Layer thickness [mm].
        sliver: Half the width of a sliver [mm].
        budget: Volume left open or laid twice [mm³].
        moving: Whether pieces move; slivers leave in any case, since a grid may lose them.
        share: Share of a piece, from the second level on, that has no room of t where it
            moves; of those of the first level, `MOVING_SHARE` of it has none.
        h: Grid spacing [mm].
        field: Distances to S.
        brr: Distances to the restraint region, or None.

    Returns:
        For each sheet the faces of pieces that move to the middle of their room, and
        faces of slivers, which are made anew from the layer before. What the sheet in the
        middle of a thin wall fills counts as slivers, whatever piece it belongs to.
    """
    moves: list[Bools] = []
    slivers: list[Bools] = []
    lasting: list[tuple[float, int, int]] = []
    deeper = False
    for k in reversed(range(len(fronts))):
        front, (gap, _) = fronts[k], gaps[k]
        piece, areas = pieces[k].piece, all_areas[k]
        total, thinly = pieces[k].areas, pieces[k].thin
        count = len(total)
        leaves = pieces[k].ending > (share if k else MOVING_SHARE) * total
        narrow = leaves & (thinly > SLIVER_SHARE * total)
        narrow &= total - thinly <= BESIDE_RATIO * t * t
        small = np.flatnonzero((total < SMALL_RATIO * t * t) & ~narrow)
        if len(small):
            starts = np.column_stack(
                [np.bincount(piece, areas * x, count) for x in face_middles(front).T]
            )[small] / np.maximum(total[small, None], 1e-12)
            low = low_pieces(starts, (k + 0.5) * t + sliver, h, field, brr)
            narrow[small[low]] = True
        leaves = narrow | (leaves & moving)
        candidates = np.flatnonzero(leaves & ~narrow)
        if deeper and leaves.all() and len(candidates):
            lost = np.where(gap < pieces[k].next_from, np.abs(gap), 0.0) / 2
            harm = np.bincount(piece, areas * lost, count)
            least = candidates[np.argmin(harm[candidates])]
            lasting.append((float(harm[least]), k, int(least)))
        deeper = deeper or not leaves.all()
        moves.insert(0, leaves & ~narrow)
        slivers.insert(0, narrow)
    for harm_done, k, number in sorted(lasting):
        budget -= harm_done
        if budget < 0:
            break
        moves[k][number] = False
    begun = False
    for k in range(len(gaps)):
        if begun:
            moves[k] |= (pieces[k].ending > LEAST_SHARE * pieces[k].areas) & ~slivers[k]
        begun = begun or bool(len(moves[k]) and (moves[k] | slivers[k]).all())
    leaving = [
        (move[every.piece], thin[every.piece]) for move, thin, every in zip(moves, slivers, pieces)
    ]
    if leaving:
        gap, (moved, anew) = gaps[0][0], leaving[0]
        walled = moved & (gap < pieces[0].next_from) & (gap + t < MIDDLE_RATIO * t)
        leaving[0] = moved & ~walled, anew | walled
    return leaving
