# SPDX-License-Identifier: Apache-2.0
"""Layers: the sheets of material that fill a part.

- `field_layers`: enveloping layers as level sets of the distance inside the part, the
  default.
- `minkowski_layers`: the paper's equations with boolean operations, literal and slow.
- `planar_layers`: flat slices, the baseline.

The way through the default engine, file by file:

1. `grid` holds the distance to S (`distance_field`), `geodesic` bends it inside the part.
2. `contour` draws the level sets, `summits` adds the last ones that a grid misses.
3. `refine`, `settle` and `tidy` put their vertices and faces onto the level.
4. `front` measures the room before the fronts meet; `leaving` chooses what leaves the
   levels, and `core` makes sheets of it (`carry`, `core_sheet`).
5. `envelopes` makes layers of what stays; `filling` chooses how well all of it fills the
   part (`coverage`) and improves on that (`mitre`, `growth`).
6. `depth_misses` tells whether a closer grid is called for.
"""

from __future__ import annotations

from vega_planner.datatypes import LayerStack, Part
from vega_planner.errors import InvalidInput
from vega_planner.progress import Report, silent
from vega_planner.settings import LayerSettings

__all__ = ["generate_layers"]


def generate_layers(
    part: Part,
    settings: LayerSettings,
    report: Report = silent,
    *,
    edge_angle_deg: float = 30.0,
) -> LayerStack:
    """Generate the layers of a part with the engine the settings name.

    Args:
        part: The part.
        settings: Engine, layer thickness and options.
        report: Progress; may raise to stop.
        edge_angle_deg: The paper's θ_edge, for handing the restraint region from layer
            to layer. Only the `minkowski` engine uses it.

    Returns:
        The layers.

    Raises:
        InvalidInput: If the engine is unknown.
        BadRestraint: If the restraint region is the whole surface.
        NoLayers: If the part yields no layer.
    """
    if settings.engine == "field":
        from vega_planner.layers.field_layers import field_layers

        return field_layers(part, settings, report)
    if settings.engine == "planar":
        from vega_planner.layers.planar import planar_layers

        return planar_layers(part, settings, report)
    if settings.engine == "minkowski":
        from vega_planner.layers.minkowski import minkowski_layers

        return minkowski_layers(part, settings, edge_angle_deg, report)
    raise InvalidInput(f"engine is '{settings.engine}'; choices: field, minkowski, planar")
