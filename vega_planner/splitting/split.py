# SPDX-License-Identifier: Apache-2.0
"""Split the layers by printability into patches, each with its tool axes."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from vega_planner.datatypes import Floats, Ints, Layer, LayerStack, Patch, TriangleGeometry
from vega_planner.parallel import map_threads
from vega_planner.part.topology import connected_pieces
from vega_planner.printability.assessment import Assessment
from vega_planner.printability.islands import neighbours_of
from vega_planner.printability.sides import INSIDE, NEITHER, OUTSIDE, SheetAssessment
from vega_planner.progress import Progress, Report
from vega_planner.settings import PrintabilitySettings
from vega_planner.splitting.border import separating_field
from vega_planner.splitting.cut import cut_mesh

if TYPE_CHECKING:
    from vega_planner.robot.workcell import Workcell

#: Pieces smaller than this share of a squared thickness hold no bead.
CRUMB = 0.5

#: Height over the plate, in layer thicknesses, below which no bead's centre can lie.
LOWEST_BEAD = 0.25

#: Unprintable area left on a printable side that ends the search for the cut.
MISLABELLED_RATIO = 3e-3

#: Times the border is moved back by two standard deviations.
ATTEMPTS = 3


@dataclass(frozen=True, eq=False)
class _Piece(TriangleGeometry):
    """A sheet being cut: mesh, fields at its vertices, labels of its faces."""

    vertices: Floats
    faces: Ints
    thickness: Floats
    outside: Floats
    inside: Floats
    outside_bad: Floats
    inside_bad: Floats
    label: Ints


def split_layers(
    stack: LayerStack,
    assessment: Assessment,
    cell: Workcell,
    settings: PrintabilitySettings,
    report: Report,
) -> tuple[Patch, ...]:
    """Cut every layer into patches that are printed from one side.

    A layer that is printable as it is gives one patch per connected piece. Where a layer
    is printed from both sides, it is cut along a regressed separating surface. What can
    be printed from neither side is left out; the assessment's report holds it. Flat layers
    stay whole, as an ordinary slicer keeps them: the report says where the tool touches.

    Args:
        stack: The layers.
        assessment: Their judgement.
        cell: Robot, tool and placement.
        settings: Orientation policy and limits.
        report: Receives progress; may raise `Cancelled`.

    Returns:
        Patches in the order of the sheets; their normals point at the nozzle.
    """
    patches: list[Patch] = []
    plate = float(cell.placement.plate_z_mm)
    pieces = list(zip(range(len(stack.sheets)), assessment.layers, assessment.sheets))
    with _one_blas_thread(any(len(np.unique(s.side)) > 1 for s in assessment.sheets)):
        for first in range(0, len(pieces), 8):
            for found in map_threads(_split_sheet, pieces[first : first + 8]):
                patches += [patch for patch in found if _holds_bead(patch, plate)]
            report(Progress("splitting", min(1.0, (first + 8) / len(pieces))))
    return tuple(patches)


def _holds_bead(patch: Patch, plate_z_mm: float) -> bool:
    """Tell whether a patch rises far enough above the plate for a bead to lie there."""
    height = patch.vertices[:, 2] - plate_z_mm
    return bool((height > LOWEST_BEAD * patch.thickness).any())


def _one_blas_thread(needed: bool) -> AbstractContextManager:
    """Keep small matrices from waking the threads of BLAS, which spin when cores are busy."""
    if not needed:
        return nullcontext()
    from threadpoolctl import threadpool_limits

    return threadpool_limits(1)


def _split_sheet(item: tuple[int, Layer, SheetAssessment]) -> list[Patch]:
    number, layer, sheet = item
    outside = sheet.outside
    inside = sheet.inside or outside
    label = np.full_like(sheet.side, OUTSIDE) if layer.kind == "planar" else sheet.side
    crumb = CRUMB * float(layer.thickness.min()) ** 2 if len(layer.thickness) else 0.0
    piece = _Piece(
        layer.vertices, layer.faces, layer.bead_thickness, outside.axes, inside.axes,
        (outside.code > 0).astype(float), (inside.code > 0).astype(float), label,
    )  # fmt: skip
    patches: list[Patch] = []
    rest = piece
    for side in (OUTSIDE, INSIDE):
        if not (rest.label == side).any():
            continue
        if (rest.label == side).all():
            kept, other = rest, None
        else:
            kept, other = _cut_off(rest, side)
        patches += _patches(kept, side, number, crumb)
        if other is None:
            break
        rest = other
    return patches


def _cut_off(piece: _Piece, side: int) -> tuple[_Piece, _Piece]:
    """Cut the region of one side off along the separating surface."""
    positive = piece.label == side
    field, deviation = separating_field(piece, neighbours_of(piece), positive)
    bad = piece.outside_bad if side == OUTSIDE else piece.inside_bad
    best = None
    for attempt in range(ATTEMPTS):
        cut = cut_mesh(piece.vertices, piece.faces, field - 2.0 * attempt * deviation)
        corners = cut.vertices[cut.faces]
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = 0.5 * np.linalg.norm(cross, axis=1)
        share = (cut.carry(bad)[cut.faces].mean(1) > 0.5) & cut.positive
        wrong = float(area[share].sum())
        if best is None or wrong < best[0]:
            best = (wrong, cut)
        if wrong <= MISLABELLED_RATIO * piece.area:
            break
    assert best is not None
    cut = best[1]
    label = piece.label[cut.source]
    # beyond the cut the border's old labels mean nothing: what is not this side takes the
    # label of the other region
    others = piece.label[~positive]
    other = INSIDE if (others == INSIDE).any() else NEITHER
    outer = np.where(cut.positive, side, np.where(label == side, other, label))
    halves = []
    for chosen in (cut.positive, ~cut.positive):
        faces, used = _compact(cut.faces[chosen], len(cut.vertices))
        halves.append(
            _Piece(
                cut.vertices[used],
                faces,
                cut.carry(piece.thickness)[used],
                cut.carry(piece.outside)[used],
                cut.carry(piece.inside)[used],
                cut.carry(piece.outside_bad)[used],
                cut.carry(piece.inside_bad)[used],
                outer[chosen],
            )
        )
    return halves[0], halves[1]


def _compact(faces: Ints, count: int) -> tuple[Ints, Ints]:
    """Renumber faces over the vertices they use; return them and the old indices."""
    mark = np.zeros(count, np.bool_)
    mark[faces.ravel()] = True
    used = np.flatnonzero(mark)
    new = np.cumsum(mark) - 1
    return new[faces], used


def _patches(piece: _Piece, side: int, number: int, crumb_mm2: float) -> list[Patch]:
    """Make a patch of each connected part of a piece."""
    if not len(piece.faces):  # the separating surface left nothing on this side
        return []
    axes = piece.outside if side == OUTSIDE else piece.inside
    length = np.linalg.norm(axes, axis=1, keepdims=True)
    if np.abs(length - 1).max() > 1e-12:  # interpolated at a cut
        axes = axes / length
    part, count = connected_pieces(len(piece.vertices), piece.faces)
    if count == 1 and side == OUTSIDE and len(piece.faces) > 8:
        return [Patch(number, piece.vertices, piece.faces, piece.thickness, axes)]
    made = []
    for k in range(count):
        chosen = part == k
        if float(piece.face_areas[chosen].sum()) < crumb_mm2:
            continue
        faces, used = _compact(piece.faces[chosen], len(piece.vertices))
        if side == INSIDE:
            faces = faces[:, ::-1]
        made.append(Patch(number, piece.vertices[used], faces, piece.thickness[used], axes[used]))
    return made
