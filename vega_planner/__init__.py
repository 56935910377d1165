# SPDX-License-Identifier: Apache-2.0
"""From a mesh to checked robot motion, in enveloping layers.

    stage          value                                                       package
    part           Part: watertight, placed, with its restraint region         part/
    cell           Workcell: robot, tool, material, placement, substrate       robot/
    layers         LayerStack: enveloping (two engines) or planar              layers/
    printability   Assessment: reach, access, solid tool                       printability/
    splitting      Patches: what can be printed in one go                      splitting/
    ordering       PrintOrder: what comes first                                ordering/
    toolpaths      ToolpathSet: pattern, spacing, linking, travel    [mm]      toolpaths/
    trajectory     PrintTrajectory: joints over time                 [SI]      trajectory/

    >>> import vega_planner
    >>> plan = vega_planner.plan("parts/part1_dome.stl")
    >>> plan.summary["layers"]
    >>> plan.write("out/dome")

Names are loaded when first used, so that importing the package costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

_HOMES = {
    "plan": "vega_planner.pipeline",
    "PrintPlan": "vega_planner.pipeline",
    "Settings": "vega_planner.settings",
    "load_settings": "vega_planner.settings",
    "load_part": "vega_planner.part",
    "Part": "vega_planner.datatypes",
    "VegaError": "vega_planner.errors",
    "Cancelled": "vega_planner.errors",
    "Progress": "vega_planner.progress",
}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'vega_planner' has no attribute '{name}'")
    return getattr(import_module(_HOMES[name]), name)
