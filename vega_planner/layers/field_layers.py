# SPDX-License-Identifier: Apache-2.0
"""The default engine: layers as level sets of the distance inside the part."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from vega_planner.datatypes import LayerStack, Part
from vega_planner.errors import BadRestraint, NoLayers
from vega_planner.layers.contour import Sheet, contour_levels
from vega_planner.layers.core import SLIVER_RATIO, Core, fill_core
from vega_planner.layers.coverage import Samples, spread_samples
from vega_planner.layers.depth_misses import depth_misses
from vega_planner.layers.distance_field import DistanceField
from vega_planner.layers.envelopes import envelopes
from vega_planner.layers.filling import Filling, fill
from vega_planner.layers.geodesic import Sources, bend_distances, is_convex_at_region
from vega_planner.layers.grid import (
    Grid,
    depths_about,
    finish,
    inside_nodes,
    sample_nodes,
    sample_part,
)
from vega_planner.layers.refine import refine_sheet
from vega_planner.layers.settle import settle_sheet
from vega_planner.layers.summits import with_summits
from vega_planner.layers.tidy import tidy_sheet
from vega_planner.layers.ways import best_filling
from vega_planner.parallel import map_threads
from vega_planner.progress import Report
from vega_planner.settings import LayerSettings

#: Spacing of the grid, in t; at most, for parts with many layers to which it makes no odds,
#: and how many vertices such a part has before refinement.
SPACING_RATIO = 0.65
WIDE_SPACING_RATIO = 0.78
COMFORTABLE_VERTICES = 1.2e5

#: Spacing where walls are thin and finely shaped, in t: with gaps and ribs narrower than
#: the grid, coarser cells hold more sheets than they can tell apart.
THIN_SPACING_RATIO = 0.45

#: Walls are thin below this mean thickness, and finely shaped below this size of faces, in t;
#: they are thick above another.
THIN_RATIO, FINE_RATIO, THICK_RATIO = 3.0, 1.5, 8.0

#: Gaps narrower than the grid matter where more than this share of its nodes is beside one.
GAP_SHARE = 0.002

#: Vertices of all layers before refinement, and nodes of the grid, that are affordable.
MOST_VERTICES = 3e6
MOST_NODES = 12e6

#: Small parts whose layers are off their depth, or fill them badly, are sampled again, with a
#: grid closer by this factor, as often as this and while it has no more nodes than this.
FINER, FINER_ROUNDS, FINER_NODES = 0.56, 2, 1.5e6

#: It stops if one leaves more than this share of what the aims for the filling were missed by.
LEFT_RATIO = 0.7

#: Open share of the volume above which a person is told.
OPEN_RATIO = 0.01


def grid_spacing(part: Part, t: float, gaps: bool = False) -> float:
    """Choose the spacing h of the grid [mm].

    About three nodes to two layers, closer where walls are thin and finely shaped; a little
    farther apart where they are thick and many layers follow each other, and as far as need
    be for a part so large that its layers would have more than `MOST_VERTICES` vertices or
    its grid more than `MOST_NODES` nodes.

    Args:
        part: The part.
        t: Layer thickness [mm].
        gaps: Whether the part is known to have gaps narrower than the grid.
    """
    area = float(part.face_areas[~part.restrained].sum())
    faces = int((~part.restrained).sum())
    thickness = 2 * part.volume / area
    fine = area < faces * (FINE_RATIO * t) ** 2

    def for_vertices(most: float) -> float:
        return float(1.5 * part.volume / (t * most)) ** (1 / 2)

    ratio = SPACING_RATIO
    if gaps or (thickness < THIN_RATIO * t and fine):
        ratio = THIN_SPACING_RATIO
    elif thickness > THICK_RATIO * t:
        ratio = min(max(for_vertices(COMFORTABLE_VERTICES) / t, ratio), WIDE_SPACING_RATIO)
    by_nodes = (float(np.prod(np.ptp(part.bounds, axis=0))) / MOST_NODES) ** (1 / 3)
    return max(ratio * t, for_vertices(MOST_VERTICES), by_nodes)


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
    spacing = grid_spacing(part, t)

    field = DistanceField.of_part(part)
    region = part.faces[part.restrained]
    # What needs but one thread each.
    begun: list[Any] = [
        partial(inside_nodes, part, spacing),
        partial(spread_samples, part),
        lambda: DistanceField(part.vertices, region) if len(region) else None,
    ]
    (state, origin, shape), samples, brr = map_threads(lambda work: work(), begun)
    grid = sample_nodes(state, origin, spacing, shape, field, report)
    best = _sampled(part, settings, field, brr, grid, samples, report, FINER_ROUNDS)
    for left in reversed(range(FINER_ROUNDS)):
        spacing = FINER * min(spacing, best.spacing)
        if _node_count(part, spacing) > FINER_NODES or not best.aims_missed:
            break
        grid = sample_part(part, field, spacing, report)
        finer = _sampled(part, settings, field, brr, grid, samples, report, left)
        before, best = best.filling.missed, min(best, finer, key=lambda way: way.rank)
        if not finer.depths_missed and finer.filling.missed > LEFT_RATIO * before > 0:
            break
    filling, warnings = best.filling, best.warnings
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


@dataclass(frozen=True)
class _Sampled:
    """The layers that a grid of some spacing has led to, and how far off they are.

    Attributes:
        filling: The layers.
        spacing: Spacing of the grid [mm].
        warnings: What a person should know.
        off_share: Share of the vertices and face centres that are off their depth.
        depths_missed: How many aims for the depth are missed.
    """

    filling: Filling
    spacing: float
    warnings: tuple[str, ...]
    off_share: float
    depths_missed: int

    @property
    def aims_missed(self) -> int:
        """How many aims are missed, that for the filling among them."""
        return self.depths_missed + (self.filling.missed > 0)

    @property
    def rank(self) -> tuple[float, ...]:
        """How many aims are missed, then how far off filling and depths are; less is better."""
        return self.aims_missed, self.filling.missed, self.off_share


def _node_count(part: Part, h: float) -> float:
    """Count the nodes of a grid, about."""
    return float(np.prod(np.ptp(part.bounds, axis=0) / h + 3))


def _sampled(
    part: Part,
    settings: LayerSettings,
    field: DistanceField,
    brr: DistanceField | None,
    grid: Grid,
    samples: Samples,
    report: Report,
    left: int,
) -> _Sampled:
    """Make the layers with a grid, or a closer one where there are gaps.

    Args:
        left: How often the part may be sampled again.
    """
    t = settings.thickness_mm
    gaps = grid.gap_share > GAP_SHARE
    closer = grid_spacing(part, t, gaps)
    if gaps and closer < grid.spacing:
        grid = sample_part(part, field, closer, report)
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

    sheets = map_threads(refined, sheets)
    straight = len(sources.box) > 0

    def core(**choices: Any) -> Core:
        if not settings.fill_core:
            made = Core.nothing(sheets, t)
        else:
            made = fill_core(part, grid, field, brr, sheets, t, **choices)
        if not any(kept.any() for kept in made.kept) and not made.cores:
            raise NoLayers(f"no layer of t = {t:g} mm fits into part '{part.name}'")
        return made

    def filled(ways: list[Core], samples: Samples) -> Filling:
        made = partial(envelopes, sheets, t=t, known={})
        depths = partial(depths_about, grid, field) if straight else None
        return fill(part, samples, ways, made, depths, t, settings.fill_core)

    small = _node_count(part, FINER * grid_spacing(part, t)) <= FINER_NODES
    again = left > 0 and _node_count(part, FINER * grid.spacing) <= FINER_NODES

    def off_depth(filling: Filling) -> tuple[float, int]:
        return depth_misses(filling.layers, field, straight) if small else (0.0, 0)

    def is_final(filling: Filling) -> bool:
        return not (again and off_depth(filling)[1])

    if settings.fill_core:
        filling = best_filling(part, samples, core, filled, t, small, is_final)
    else:
        filling = filled([core()], samples)
    return _Sampled(filling, grid.spacing, warnings, *off_depth(filling))
