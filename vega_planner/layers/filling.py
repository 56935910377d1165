# SPDX-License-Identifier: Apache-2.0
"""How well the sheets fill a part, and what is done about the places they leave open.

Where much stays open, sharp edges are mitred, last layers whose room is not t lean towards
laying twice, and all sheets are a little thicker, as far as their facets are off. At last
sheets grow towards the pockets that are left.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from vega_planner.datatypes import Layer, Part
from vega_planner.layers.core import LEAN, Core
from vega_planner.layers.coverage import Coverage, Samples, measure_coverage, spread_samples
from vega_planner.layers.growth import Gaps
from vega_planner.layers.mitre import Depths, Strips, find_strips
from vega_planner.parallel import map_threads

#: How far the facets of two sheets are apart at most between their vertices, on average [mm].
FACETS_MM = 0.003

#: Open share of the volume above which something is done about it.
FILLED_RATIO = 0.004

#: Aims for what stays open and for what is laid twice.
OPEN_AIM, FULL_AIM = 0.0045, 0.0197

#: How much worse an open volume is than as much laid twice.
OPEN_WEIGHT = 4.0

#: Levels stay as they are unless the core that begins early is better by this factor.
EARLY_GAIN = 1.3

#: And unless they have more area than this, in that of the other sheets: more way to lay, in
#: thinner beads.
MORE_AREA = 1.15

#: The farthest that last layers lean.
MOST_LEAN = 0.9

#: How much material covering an open volume is worth, step by step, while sheets grow.
GROWTH_WEIGHTS = (1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0)

#: Spacing of the points that sheets grow towards, at best and at most, in t; how many are
#: affordable where both aims may be met, and where the one for what is laid twice is missed.
GROWTH_RATIO, WIDEST_RATIO, MOST_SAMPLES, FEW_SAMPLES = 1 / 5, 1 / 3, 2e6, 5e5

#: Points closer than this find the pockets, so that others are only looked at about them, in t.
CLOSE_RATIO = 0.55

#: Material laid twice for each volume that sheets grow to cover, at least.
LEAST_COST = 0.3


@dataclass(frozen=True, eq=False)
class Filling:
    """Sheets, and how well they fill the part.

    Attributes:
        layers: The envelope layers, outermost first.
        cores: The sheets of the core.
        coverage: What they cover.
        even: The same before last layers leant any farther, or None where this is it.
    """

    layers: tuple[Layer, ...]
    cores: tuple[Layer, ...]
    coverage: Coverage
    even: Filling | None = None

    @property
    def sheets(self) -> tuple[Layer, ...]:
        """All sheets, cores last."""
        return (*self.layers, *self.cores)

    @property
    def area(self) -> float:
        """Area of all sheets [mm²]."""
        return sum(sheet.area for sheet in self.sheets)

    @property
    def uncovered(self) -> float:
        """Volume inside no sheet's own thickness, over the part's volume."""
        return self.coverage.uncovered

    @property
    def overfill(self) -> float:
        """Material beyond what the sheets cover, over the part's volume."""
        return self.coverage.overfill

    @property
    def harm(self) -> float:
        """What is open and what is laid twice, weighed."""
        return OPEN_WEIGHT * self.uncovered + self.overfill

    @property
    def missed(self) -> float:
        """How far the aims are missed, weighed as `harm` is."""
        open_volume = max(self.uncovered - OPEN_AIM, 0.0)
        return OPEN_WEIGHT * open_volume + max(self.overfill - FULL_AIM, 0.0)

    @property
    def rank(self) -> tuple[float, float]:
        """How far the aims are missed, then the harm; less is better."""
        return self.missed, self.harm

    @property
    def grown_overfill(self) -> float:
        """What is laid twice, at least, once sheets have grown to fill the pockets."""
        return self.overfill + LEAST_COST * max(self.uncovered - OPEN_AIM, 0.0)

    @property
    def hope(self) -> tuple[float, float]:
        """How far growing falls short of the aims, at least, then the harm; less is better."""
        return max(self.grown_overfill - FULL_AIM, 0.0), self.harm

    def measured(self, part: Part, samples: Samples) -> Filling:
        """Measure the same sheets by other points of the part; `even` stays as it is."""
        return replace(self, coverage=measure_coverage(part, samples, self.sheets))


def fill(
    part: Part,
    samples: Samples,
    cores: list[Core],
    envelopes: Callable[[Core, float], list[Layer]],
    depths: Depths | None,
    t: float,
    improve: bool,
) -> Filling:
    """Choose how the core is filled, and fill what stays open as far as it pays.

    Args:
        part: The part.
        samples: Points of the part.
        cores: One way to fill the core, or a second one in which levels stay as they are.
        envelopes: Makes the envelope layers that belong to a core, leaning by a share.
        depths: Measures depths, as far as strips along edges need it; None where that is
            not possible.
        t: Layer thickness [mm].
        improve: Whether anything is done about what stays open.

    Returns:
        The best filling found.
    """
    made: dict[tuple[int, float], list[Layer]] = {}

    def filling(
        core: Core,
        lean: float,
        strips: Sequence[Strips] = (),
        thinner: Filling | None = None,
        allowance: float = 0.0,
    ) -> Filling:
        if (id(core), lean) not in made:
            made[id(core), lean] = envelopes(core, lean)
        sheets = (*made[id(core), lean], *core.cores)
        count = len(sheets) - len(core.cores)
        if strips:
            pairs = zip(strips, sheets)
            sheets = tuple(map_threads(lambda pair: pair[0].on(pair[1], t), pairs))
        if allowance:
            sheets = tuple(allow_for_facets(sheet, allowance) for sheet in sheets)
        before = thinner.coverage if thinner else None
        coverage = measure_coverage(part, samples, sheets, before)
        return Filling(sheets[:count], sheets[count:], coverage)

    core = cores[0]
    best = filling(core, LEAN)
    for other in cores[1:]:
        kept = filling(other, LEAN)
        more = kept.area > MORE_AREA * best.area
        if kept.harm < EARLY_GAIN * best.harm and not more:
            core, best = other, kept
    if best.uncovered < FILLED_RATIO or not improve:
        return best
    at_depth = {"envelope": depths, "core": None}
    strips = map_threads(
        lambda sheet: find_strips(sheet, t, at_depth[sheet.kind]), (*best.layers, *best.cores)
    )
    mitred = filling(core, LEAN, strips, best)
    if mitred.harm < best.harm:
        best = mitred
    else:
        strips = []
    if best.uncovered < FILLED_RATIO:
        return best
    ways = {LEAN: best, MOST_LEAN: filling(core, MOST_LEAN, strips, best)}
    gain = best.uncovered - ways[MOST_LEAN].uncovered
    if ways[MOST_LEAN].overfill > FULL_AIM and 0 < best.uncovered - OPEN_AIM < gain:
        between = LEAN + (best.uncovered - OPEN_AIM) / gain * (MOST_LEAN - LEAN)
        ways[between] = filling(core, between, strips, best)
    lean = min(ways, key=lambda lean: ways[lean].rank)
    best = ways[lean]
    if best.uncovered > OPEN_AIM:
        thicker = filling(core, lean, strips, best, FACETS_MM)
        best = min(best, thicker, key=lambda way: way.rank)
    return replace(best, even=ways[LEAN])


def fill_pockets(part: Part, samples: Samples, way: Filling, t: float) -> Filling:
    """Let sheets grow towards what they leave open, until little enough is.

    Args:
        part: The part.
        samples: Points of the part.
        way: The sheets.
        t: Layer thickness [mm].

    Returns:
        The sheets, thicker where it pays; unchanged where too much would be laid twice.
    """
    most = MOST_SAMPLES if way.grown_overfill < FULL_AIM else FEW_SAMPLES
    fewest, finest = (part.volume / (share * t) ** 3 for share in (WIDEST_RATIO, GROWTH_RATIO))
    if fewest > most:
        return way
    fine = spread_samples(part, int(min(finest, most)))
    before = None
    if samples.spacing < CLOSE_RATIO * t:
        # So close that next to no pocket lies between them.
        pockets = samples.points(way.coverage.open_nodes)
        before = replace(way.coverage, open_nodes=fine.about(pockets, samples.spacing))
    open_nodes = measure_coverage(part, fine, way.sheets, before).open_nodes
    gaps = Gaps.between(way.sheets, fine.points(open_nodes), fine.spacing**3, t)
    best = way
    for weight in GROWTH_WEIGHTS:
        if way.uncovered < OPEN_AIM:
            break
        sheets = gaps.filled(way.sheets, weight, t)
        coverage = measure_coverage(part, samples, sheets, way.coverage)
        first = len(way.layers)
        way = Filling(sheets[:first], sheets[first:], coverage)
        best = min(best, way, key=lambda way: way.rank)
    return best


def allow_for_facets(sheet: Layer, allowance: float) -> Layer:
    """Make a sheet thicker by as much as its facets are off its surface; beads stay.

    Args:
        sheet: The sheet.
        allowance: How much [mm].
    """
    thickness = sheet.thickness + allowance
    return replace(sheet, thickness=thickness, mitre=thickness / sheet.bead_thickness)
