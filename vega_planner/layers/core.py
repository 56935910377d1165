# SPDX-License-Identifier: Apache-2.0
"""The core: what the last layers leave over, and sheets of their own thickness to fill it.

Layer N takes the band of depths N t to (N + 1) t. Where the part is thin, the fronts
from both sides meet (or reach the restraint region) at a depth m that is no multiple of
t: the last band is too narrow for its layer, or a gap stays open behind it. With the
room g = m - (N + 1) t behind a band:

- g < t / 2: the last layer gets the thickness t + g, between t/2 and 3/2 t. If that
  matters for the part as a whole (thin walls), it also moves to the middle of its room
  and becomes a sheet of the core. Beside layers that stay, a gap between two fronts gets
  a sheet of its own on the mid-surface; where most gaps are wide enough for a good one,
  layers stay.
- g a little above t / 2: the next layer is a sliver that a grid may lose. A sheet on the
  mid-surface takes its place, or one made here from the layer before it where fronts meet
  on a line or end at the restraint region.
- A wall thinner than a layer gets one sheet on its mid-surface, and a floor thinner than
  that one half-way to the restraint region. What they fill is not laid twice.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vega_planner.datatypes import Bools, Floats, Layer, Part
from vega_planner.layers.carry import carried_room
from vega_planner.layers.contour import Sheet
from vega_planner.layers.core_faces import filled_by_wall, is_flat, leave_out, missing_ahead
from vega_planner.layers.core_sheet import add_core_sheet
from vega_planner.layers.distance_field import DistanceField
from vega_planner.layers.front import (
    END_RATIO,
    Front,
    face_areas,
    face_gaps,
    sheet_front,
    spread_room,
    thin_walls,
)
from vega_planner.layers.grid import Grid
from vega_planner.layers.leaving import MIDDLE_RATIO, MOVING_SHARE, Pieces, leaving_faces
from vega_planner.parallel import map_threads

#: Pieces of a level set up to this width, in t, count as slivers that a grid may lose.
SLIVER_RATIO = 0.66

#: Share of the volume that last layers may leave open or lay twice before they move.
TOLERATED_RATIO = 0.002

#: Share of the volume that pieces may leave open or lay twice that stay only because a
#: deeper level does.
STAYING_RATIO = 0.006

#: How far sheets lean towards laying twice instead of leaving open, to begin with.
LEAN = 0.3

#: Gaps between two fronts from this half width, in t, get a sheet of their own: as much
#: is laid twice then, at the least thickness, as else by the sheets on both sides.
WIDE_RATIO = 0.125

#: They have one up to this half width, in t, where the next level is a sliver.
ONE_RATIO = 0.75


@dataclass(frozen=True, eq=False)
class Core:
    """How the core is filled.

    Attributes:
        cores: The sheets of the core.
        room: Room for the thickness at the vertices of each envelope sheet [mm].
        kept: Faces of each envelope sheet that stay (the others moved into the core).
    """

    cores: tuple[Layer, ...]
    room: tuple[Floats, ...]
    kept: tuple[Bools, ...]

    @property
    def begins_early(self) -> bool:
        """Whether levels have become sheets of the core because one before them moved."""
        return any(not kept.any() and len(kept) for kept in self.kept[:-1])

    def is_like(self, other: Core) -> bool:
        """Whether the same faces stay, with the same room, and the sheets are the same."""
        mine, theirs = (
            (*c.kept, *c.room, *(sheet.vertices for sheet in c.cores)) for c in (self, other)
        )
        return len(mine) == len(theirs) and all(map(np.array_equal, mine, theirs))

    @classmethod
    def nothing(cls, sheets: list[Sheet], t: float) -> Core:
        """Leave the sheets as they are."""
        room = tuple(np.full(len(sheet.vertices), t) for sheet in sheets)
        return cls((), room, tuple(np.ones(len(sheet.faces), bool) for sheet in sheets))


def leant(room: Floats, t: float, lean: float) -> Floats:
    """Choose the thickness of a sheet that stays where its room is another one [mm].

    With the room t + g, either g / 2 stays open on both sides or as much is laid twice.

    Args:
        room: Room for it [mm].
        t: Layer thickness [mm].
        lean: From 0, as much open as laid twice, to 1, none open.
    """
    return np.clip(room + lean * np.abs(t - room), t / 2, 1.5 * t)


def fill_core(
    part: Part,
    grid: Grid,
    field: DistanceField,
    brr: DistanceField | None,
    sheets: list[Sheet],
    t: float,
    staying_ratio: float = STAYING_RATIO,
    moving_share: float = MOVING_SHARE,
    carried: bool = True,
) -> Core:
    """Make the sheets that fill what the envelope layers leave over.

    Args:
        part: The part.
        grid: Distances at the nodes.
        field: Distances to S.
        brr: Distances to the restraint region, or None.
        sheets: The envelope sheets, at depths (N + 1/2) t.
        t: Layer thickness [mm].
        staying_ratio: Share of the volume that pieces may leave open or lay twice that
            stay only because a deeper level does.
        moving_share: Share of a piece, from the second level on, that has no room of t
            where it moves.
        carried: Whether pieces that move take the room beside where it was measured, and
            those of the first level carry it round corners.

    Returns:
        The sheets of the core, and what changes of the envelope sheets.
    """
    sliver = SLIVER_RATIO * t / 2

    def look(k: int) -> tuple[Front, tuple[Floats, Bools], Floats, Pieces]:
        if k < 0:
            front = thin_walls(part, grid, field, brr, t / 2 + sliver)
        else:
            front = sheet_front(k, sheets[k], grid, field, brr, t, sliver)
        (gap, opposed), areas = face_gaps(front, t), face_areas(front)
        pieces = Pieces.of_front(front, gap, opposed, areas, t, sliver, WIDE_RATIO * t)
        return front, (gap, opposed), areas, pieces

    fronts, gaps, areas, pieces = zip(*map_threads(look, range(-1, len(sheets))))
    moving = sum(piece.volume for piece in pieces[1:]) > TOLERATED_RATIO * part.volume
    rooms = [np.full(len(sheet.vertices), t) for sheet in sheets]
    kept = [np.ones(len(sheet.faces), bool) for sheet in sheets]
    cores: list[Layer] = []
    last: list[Layer | None] = [None] * (len(sheets) + 1)
    walls, (gap, opposed) = fronts[0], gaps[0]
    chosen = gap < MIDDLE_RATIO * t
    budget = staying_ratio * part.volume
    leaving = leaving_faces(
        fronts[1:], gaps[1:], areas[1:], pieces[1:], t, sliver, budget, moving, moving_share,
        grid.spacing, field, brr,
    )  # fmt: skip
    if sheets and chosen.any():
        stays = ~(leaving[0][0] | leaving[0][1])
        leave_out(walls, chosen, sheets[0], stays, t)
    reach, walls_most = spread_room(walls), t + pieces[0].next_from
    thin = [
        add_core_sheet(cores, field, walls, chosen & opposed, reach, 0.0, True, t, walls_most),
        add_core_sheet(cores, field, walls, chosen & ~opposed, reach, 0.0, False, t, walls_most),
    ]

    def move(k: int) -> list[Layer]:
        """Move what leaves a level to the middle of its room."""
        mine: list[Layer] = []
        front, (moved, slivers) = fronts[k + 1], leaving[k]
        most = t + pieces[k + 1].next_from
        kept[k] &= ~moved & ~slivers
        for wall in thin if k == 0 else ():
            if wall is not None and moved.any():
                moved = moved & ~filled_by_wall(front, moved, spread_room(front), wall, t, most)
        beside = np.isfinite(front.aside)
        rooms[k][beside] = front.aside[beside] - k * t
        if not moved.any():
            return mine
        room, ends = np.minimum(front.room, front.aside), END_RATIO
        if carried:
            room = np.minimum(spread_room(front), front.aside)
        if carried and k == 0:
            room, ends = carried_room(front, moved, room, field, sheets[1:2], t), 1.0
        last[k] = add_core_sheet(mine, field, front, moved, room, k * t, False, t, most, ends)
        return mine

    def fill_behind(k: int) -> list[Layer]:
        """Fill the gaps behind a level, where the next one is a sliver or there is none."""
        mine: list[Layer] = []
        front, (gap, opposed) = fronts[k + 1], gaps[k + 1]
        next_from = pieces[k + 1].next_from
        most = t + next_from
        lost = (gap >= next_from) & (gap < t / 2 + sliver)
        lost &= (gap >= MIDDLE_RATIO * t) | (k >= 0)
        for wall in thin if k < 0 else ():
            if wall is not None and lost.any():
                lost &= ~filled_by_wall(front, lost, spread_room(front), wall, t, most)
        if lost.any() and k + 1 < len(sheets):
            lost = missing_ahead(front, lost, gap, sheets[k + 1], kept[k + 1], last[k + 1], t)
        own = (gap < next_from) & kept[k] if k >= 0 else np.zeros(len(gap), bool)
        if not own.any() and not lost.any():
            return mine
        if k >= 0:
            spread = np.minimum(spread_room(front), front.aside)
            one = lost & opposed & (gap < ONE_RATIO * t)
            one[one] = is_flat(front, np.flatnonzero(one), spread, field)
            wide = (own & opposed & (gap >= WIDE_RATIO * t)) | one
            between = spread
            if carried and wide.any():
                between = carried_room(front, wide, front.room, field, (), t)
                between = np.where(np.isfinite(between), between, spread)
            add_core_sheet(mine, field, front, wide, between, (k + 1) * t, True, t, most)
            narrow = np.unique(front.faces[own & ~wide])
            rooms[k][narrow] = np.where(np.isfinite(spread), spread - k * t, t)[narrow]
            lost &= ~wide
        room = spread_room(front)
        add_core_sheet(mine, field, front, lost, room, (k + 1) * t, False, t, most)
        return mine

    levels = range(len(sheets))
    made = [*map_threads(move, levels), *map_threads(fill_behind, (-1, *levels))]
    cores += [sheet for mine in made for sheet in mine]
    cores = [replace(sheet, index=index) for index, sheet in enumerate(cores)]
    _join_core(cores, sheets, rooms, kept, t)
    return Core(tuple(cores), tuple(rooms), tuple(kept))


def _join_core(
    cores: list[Layer], sheets: list[Sheet], rooms: list[Floats], kept: list[Bools], t: float
) -> None:
    """Let the core begin where a whole level has moved into it: what is deeper follows."""
    begun = False
    for k, sheet in enumerate(sheets):
        begun = begun or not kept[k].any()
        if not begun or not kept[k].any():
            continue
        used, numbers = np.unique(sheet.faces[kept[k]], return_inverse=True)
        cores.append(
            Layer(
                index=len(cores),
                kind="core",
                depth_mm=sheet.depth,
                vertices=sheet.vertices[used],
                faces=numbers.reshape(-1, 3),
                thickness=leant(rooms[k][used], t, LEAN),
            )
        )
        kept[k][:] = False
