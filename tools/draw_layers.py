# SPDX-License-Identifier: Apache-2.0
"""Draw the picture of the README: the layers and the toolpath of a sample part, cut open."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from vega_planner import load_settings, plan
from vega_planner.viewer.pictures import View, draw, png
from vega_planner.viewer.plan_page import layer_scene, path_scene

ROOT = Path(__file__).resolve().parent.parent


def main() -> int:
    """Plan the dome and write docs/pictures/layers.png."""
    part = ROOT / "parts" / "part1_dome.stl"
    result = plan(part, load_settings(part.with_suffix(".yaml")))
    view = View(width=560, height=420)
    width = 0.4 * result.settings.toolpaths.width_mm
    pictures = [
        draw(layer_scene(result.stack.layers), view),
        draw(path_scene(result.toolpaths), view, width),
    ]
    target = ROOT / "docs" / "pictures" / "layers.png"
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_bytes(png(np.concatenate(pictures, axis=1)))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
