# SPDX-License-Identifier: Apache-2.0
"""The default engine: layers as level sets of the distance inside the part."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Layer, LayerStack, Part
from vega_planner.errors import BadRestraint, NoLayers
from vega_planner.layers.contour import contour_levels
from vega_planner.layers.distance_field import DistanceField
from vega_planner.layers.grid import sample_part
from vega_planner.progress import Report
from vega_planner.settings import LayerSettings


def grid_spacing(part: Part, t: float) -> float:
    """Choose the spacing h of the grid [mm]."""
    return 0.65 * t


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
    grid = sample_part(part, field, brr, grid_spacing(part, t), t / 2, t, report)
    sheets = contour_levels(grid, field, brr, t / 2, t)
    layers = tuple(
        Layer(
            index=k,
            kind="envelope",
            depth_mm=sheet.depth,
            vertices=sheet.vertices,
            faces=sheet.faces,
            thickness=np.full(len(sheet.vertices), t),
        )
        for k, sheet in enumerate(sheets)
    )
    if not layers:
        raise NoLayers(f"no layer fits: the part is thinner than t = {t:g} mm everywhere")
    return LayerStack(part=part, engine="field", thickness_mm=t, layers=layers)
