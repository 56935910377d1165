# SPDX-License-Identifier: Apache-2.0
"""The default engine: layers as level sets of the distance inside the part."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints, Layer, LayerStack, Part
from vega_planner.errors import BadRestraint, NoLayers
from vega_planner.layers.contour import Sheet, contour_levels
from vega_planner.layers.core import SLIVER_RATIO, Core, fill_core, leant
from vega_planner.layers.coverage import spread_samples
from vega_planner.layers.distance_field import DistanceField
from vega_planner.layers.filling import Filling, fill, grown
from vega_planner.layers.folds import folded_ears
from vega_planner.layers.geodesic import Sources, bend_distances, is_convex_at_region
from vega_planner.layers.grid import finish, sample_part
from vega_planner.layers.refine import refine_sheet
from vega_planner.layers.settle import settle_sheet
from vega_planner.layers.summits import with_summits
from vega_planner.layers.tidy import tidy_sheet
from vega_planner.parallel import map_threads
from vega_planner.progress import Report
from vega_planner.settings import LayerSettings

#: Spacing of the grid, in t.
SPACING_RATIO = 0.65

#: Spacing where walls are thin and finely shaped, in t: with gaps and ribs narrower than
#: the grid, coarser cells hold more sheets than they can tell apart.
THIN_SPACING_RATIO = 0.45

#: Walls are thin below this mean thickness, and finely shaped below this size of faces, in t.
THIN_RATIO, FINE_RATIO = 3.0, 1.5

#: Gaps narrower than the grid matter where more than this share of its nodes is beside one.
GAP_SHARE = 0.002

#: Vertices of all layers before refinement, and nodes of the grid, that are affordable.
MOST_VERTICES = 3e6
MOST_NODES = 12e6

#: Open share of the volume above which a person is told.
OPEN_RATIO = 0.01


def grid_spacing(part: Part, t: float, gaps: bool = False) -> float:
    """Choose the spacing h of the grid [mm].

    About two nodes to a layer, closer where walls are thin and finely shaped; farther apart
    for a part so large that its layers would have more than `MOST_VERTICES` vertices or its
    grid more than `MOST_NODES` nodes.

    Args:
        part: The part.
        t: Layer thickness [mm].
        gaps: Whether the part is known to have gaps narrower than the grid.
    """
    area = float(part.face_areas[~part.restrained].sum())
    faces = int((~part.restrained).sum())
    thin = 2 * part.volume < THIN_RATIO * t * area
    fine = area < faces * (FINE_RATIO * t) ** 2
    ratio = THIN_SPACING_RATIO if gaps or (thin and fine) else SPACING_RATIO
    by_vertices = (1.5 * part.volume / (t * MOST_VERTICES)) ** (1 / 2)
    by_nodes = (float(np.prod(np.ptp(part.bounds, axis=0))) / MOST_NODES) ** (1 / 3)
    return max(ratio * t, by_vertices, by_nodes)


def field_layers(part: Part, settings: LayerSettings, report: Report) -> LayerStack:
    """Generate the enveloping layers of a part as level sets of the distance to S.

    Eroding by r and then by s is eroding by r + s wherever the way to the nearest point
    of S stays inside the part, so layer N is the set at distance (N + 1/2) t.

    Args:
        part: The part.
        settings: Layer thickness t and options.
        report: Progress; may raise to stop.

    Returns:
        The layers, outermost first.

    Raises:
        BadRestraint: If the restraint region is the whole surface.
        NoLayers: If no layer fits into the part.

    Source:
        [VEGA]_, section II.
    """
    if part.restrained.all():
        raise BadRestraint("the restraint region is the whole surface; nothing is enveloped")
    t = settings.thickness_mm
    field = DistanceField.of_part(part)
    brr = None
    if part.restrained.any():
        brr = DistanceField(part.vertices, part.faces[part.restrained])
    grid = sample_part(part, field, grid_spacing(part, t), report)
    gaps = grid.gap_share > GAP_SHARE
    if gaps and grid_spacing(part, t, gaps) < grid.spacing:
        grid = sample_part(part, field, grid_spacing(part, t, gaps), report)
    sources = Sources.straight(field)
    warnings: tuple[str, ...] = ()
    if brr is not None and not is_convex_at_region(part):
        sources, changed = bend_distances(part, grid, field, brr, t, report)
        if changed > 0:
            warnings = (
                f"{changed:.1%} of the volume lies behind the restraint region as seen from "
                "the surface; its layers follow the distance inside the part, not the "
                "straight one",
            )
    finish(grid, sources.tri, brr, t / 2, t, bent=len(sources.box) == 0)
    sheets = contour_levels(grid, sources, brr, t / 2, t)
    if len(sources.box):
        sheets = with_summits(grid, field, brr, sheets, t, SLIVER_RATIO * t / 2)
    settle = gaps and len(sources.box) > 0

    def refined(sheet: Sheet) -> Sheet:
        sheet = refine_sheet(sheet, grid, sources, brr)
        return tidy_sheet(settle_sheet(sheet, field, brr) if settle else sheet, sources, t)

    # Samples need but one thread, which sheets keep the other ones from waiting for.
    works: list[Any] = [partial(spread_samples, part), *(partial(refined, s) for s in sheets)]
    samples, *sheets = map_threads(lambda work: work(), works)
    straight = len(sources.box) > 0

    def filled(carried: bool) -> Filling:
        ways = [Core.nothing(sheets, t)]
        if settings.fill_core:
            core = partial(fill_core, part, grid, field, brr, sheets, t, carried=carried)
            ways = [core()]
            if ways[0].begins_early:
                # Keeping all levels as they are costs less than it gains where walls vary.
                ways.append(core(staying_ratio=1.0))
        if not any(kept.any() for kept in ways[0].kept) and not ways[0].cores:
            raise NoLayers(f"no layer of t = {t:g} mm fits into part '{part.name}'")
        made = partial(envelopes, sheets, t=t)
        return fill(part, samples, ways, made, field, t, straight, settings.fill_core)

    filling = filled(carried=True)
    if settings.fill_core and filling.missed:
        ways = [filling, filled(carried=False)]
        filling = min(ways, key=lambda way: way.rank)
        if filling.missed:
            ways = [filling, *(grown(part, samples, way, t) for way in ways)]
            filling = min(ways, key=lambda way: way.rank)
    if filling.uncovered > OPEN_RATIO:
        warnings += (f"{filling.uncovered:.1%} of the volume is covered by no layer",)
    return LayerStack(
        part=part,
        engine="field",
        thickness_mm=t,
        layers=filling.layers,
        cores=filling.cores,
        uncovered_ratio=filling.uncovered,
        overfill_ratio=filling.overfill,
        warnings=warnings,
    )


def envelopes(sheets: list[Sheet], core: Core, lean: float, *, t: float) -> list[Layer]:
    """Make layers of what stays of the level sets, as far as one is left."""

    def envelope(k: int) -> Layer:
        sheet = sheets[k]
        kept = core.kept[k]
        # Two open edges and the one opposite to them are all on the rim.
        corners = sheet.rim[sheet.faces].sum(1) if sheet.rim.any() else np.zeros(0)
        if (corners == 3).any():
            beside = np.flatnonzero(corners >= 2)
            ears = folded_ears(sheet.vertices, sheet.faces[beside])
            kept = kept.copy()
            kept[beside[ears & (corners[beside] == 3)]] = False
        vertices, faces, thickness = kept_faces(sheet, kept, leant(core.room[k], t, lean))
        for array in (vertices, faces, thickness):
            if array is not sheet.vertices and array is not sheet.faces:
                array.flags.writeable = False  # or a layer would copy it
        return Layer(
            index=k,
            kind="envelope",
            depth_mm=sheet.depth,
            vertices=vertices,
            faces=faces,
            thickness=thickness,
        )

    layers = map_threads(envelope, range(len(sheets)))
    while layers and len(layers[-1].faces) == 0:
        layers.pop()
    return layers


def kept_faces(sheet: Sheet, kept: Bools, thickness: Floats) -> tuple[Floats, Ints, Floats]:
    """Leave out the faces of a sheet that are not kept, and the vertices only they use."""
    faces = sheet.faces if kept.all() else sheet.faces[kept]
    used = np.zeros(len(sheet.vertices), bool)
    used[faces] = True
    if used.all():
        return sheet.vertices, faces, thickness
    number = np.cumsum(used) - 1
    return sheet.vertices[used], number[faces], thickness[used]
