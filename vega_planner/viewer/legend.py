# SPDX-License-Identifier: Apache-2.0
"""What the colours mean, and how the page looks: pieces of HTML for the panel."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vega_planner.datatypes import REASON_CODES, Ints
from vega_planner.viewer.colours import REASON_COLOURS, layer_colour, speed_colours
from vega_planner.viewer.explain import MEANINGS
from vega_planner.viewer.html_page import text
from vega_planner.viewer.stage import GRID_MM

#: Background of the picture; long lines of a command are wrapped.
STYLE = """<style>
canvas[data-engine] { background: linear-gradient(#eef1f5, #c9d1db) }
pre, pre code { white-space: pre-wrap !important; overflow-wrap: anywhere }
</style>"""


def legend(reasons: Sequence[Ints], *, by_speed: bool) -> str:
    """Name the colours that are seen.

    Args:
        reasons: Per layer 0 where printable, else 1 + index into `REASON_CODES`.
        by_speed: Whether the toolpath is coloured by speed, not by layer.

    Returns:
        HTML.
    """
    rows = [_ramp([layer_colour(n, 5) for n in range(5)], "outer layer", "core")]
    if by_speed:
        speeds = np.linspace(0.0, 1.0, 5)
        shades = speed_colours(speeds, np.ones(5, bool)).tolist()
        rows.append(_ramp(shades, "tip stands", "full speed"))
    codes = np.unique(np.concatenate([np.unique(one) for one in reasons] or [np.zeros(0, int)]))
    for code in codes[codes > 0]:
        name = REASON_CODES[code - 1]
        words = f"{name.replace('_', ' ')}: {MEANINGS[name]}"
        rows.append(_square(REASON_COLOURS[name]) + text(words))
    rows.append(f"grid {GRID_MM:g} mm")
    lines = "".join(f'<div style="margin:4px 0">{row}</div>' for row in rows)
    return f'<div style="padding:4px 12px;font-size:13px;line-height:1.35">{lines}</div>'


def _square(colour: Sequence[int]) -> str:
    return (
        f'<span style="display:inline-block;width:12px;height:12px;border-radius:2px;'
        f'margin-right:6px;background:rgb({",".join(map(str, colour))})"></span>'
    )


def _ramp(colours: Sequence[Sequence[int]], low: str, high: str) -> str:
    stops = ",".join(f"rgb({','.join(map(str, colour))})" for colour in colours)
    return (
        f'{text(low)} <span style="display:inline-block;width:90px;height:10px;'
        f'border-radius:2px;background:linear-gradient(90deg,{stops})"></span> {text(high)}'
    )
