# SPDX-License-Identifier: Apache-2.0
"""Charts as SVG text: violins of distributions, and the scale of a heat map."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from vega_planner.datatypes import Floats
from vega_planner.viewer.html_page import text
from vega_planner.viewer.pictures import diverging

_COLOURS = ("#2c5aa0", "#d9772b", "#2b8a4b", "#8a3fa0")
_BINS = 72


def violins(groups: Mapping[str, tuple[Floats, Floats]], label: str) -> str:
    """Draw the distribution of each group as a violin.

    Args:
        groups: Values >= 0 and their weights by name.
        label: What the values are, with their unit.

    Returns:
        An `<svg>`; a dash marks the mean of each group.
    """
    width, height, left, bottom = 110 * max(len(groups), 1) + 60, 260, 52, 34
    top = max((_top(*group) for group in groups.values()), default=1.0)
    plot = height - bottom - 10

    def y(value: float) -> float:
        return 10 + plot * (1 - value / top)

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
        f'role="img" font-family="system-ui,sans-serif" font-size="12">'
    ]
    step = _round_step(top / 4)
    digits = max(0, -int(np.floor(np.log10(step) + 1e-9)))
    for k in range(int(top / step + 1e-9) + 1):
        value = step * k
        mark = f"{value:.{digits}f}"
        parts.append(
            f'<path d="M{left} {y(value):.1f}H{width}" stroke="#e3e6ea"/>'
            f'<text x="{left - 6}" y="{y(value) + 4:.1f}" text-anchor="end">{mark}</text>'
        )
    middle = 10 + plot / 2
    parts.append(
        f'<text x="12" y="{middle}" transform="rotate(-90 12 {middle})" '
        f'text-anchor="middle">{text(label)}</text>'
    )
    for index, (name, (values, weights)) in enumerate(groups.items()):
        centre = left + 60 + 110 * index
        parts.append(_violin(values, weights, top, centre, y, _COLOURS[index % len(_COLOURS)]))
        parts.append(
            f'<text x="{centre}" y="{height - 12}" text-anchor="middle">{text(name)}</text>'
        )
    return "".join(parts) + "</svg>"


def _round_step(length: float) -> float:
    """Choose 1, 2 or 5 times a power of ten, at least as long as asked."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(power * next(m for m in (1, 2, 5, 10) if m * power >= length * (1 - 1e-9)))


def _top(values: Floats, weights: Floats) -> float:
    order = np.argsort(values, kind="stable")
    total = np.cumsum(weights[order])
    at = min(int(np.searchsorted(total, 0.995 * total[-1])), len(order) - 1)
    return max(float(values[order[at]]) * 1.05, 1e-3)


def _violin(
    values: Floats,
    weights: Floats,
    top: float,
    centre: float,
    y: Callable[[float], float],
    colour: str,
) -> str:
    edges = np.linspace(0, top, _BINS + 1)
    shares, _ = np.histogram(values, edges, weights=weights)
    smooth = np.convolve(np.pad(shares, 2, "reflect"), [0.1, 0.2, 0.4, 0.2, 0.1], "valid")
    half = 46 * smooth / max(float(smooth.max()), 1e-12)
    heights = [y(value) for value in (edges[:-1] + edges[1:]) / 2]
    right = [f"{centre + h:.1f} {at:.1f}" for h, at in zip(half, heights)]
    left = [f"{centre - h:.1f} {at:.1f}" for h, at in zip(half, heights)][::-1]
    mean = y(min(float(np.average(values, weights=weights)), top))
    return (
        f'<path d="M{"L".join(right + left)}Z" fill="{colour}" fill-opacity=".65" '
        f'stroke="{colour}"/>'
        f'<path d="M{centre - 30} {mean:.1f}h60" stroke="#111" stroke-width="2"/>'
    )


def _signed(value: float) -> str:
    return f"{value:+.2f}" if value else "0"


def heat_scale(limit: float, label: str) -> str:
    """Draw the scale of a heat map from -limit to limit."""
    cells = []
    for k in range(60):
        red, green, blue = diverging(np.array([-limit + 2 * limit * (k + 0.5) / 60]), limit)[0]
        cells.append(
            f'<rect x="{10 + 6 * k}" y="4" width="6.5" height="16" '
            f'fill="#{int(red):02x}{int(green):02x}{int(blue):02x}"/>'
        )
    marks = "".join(
        f'<text x="{10 + 180 * (k + 1)}" y="36" text-anchor="middle">{_signed(k * limit)}</text>'
        for k in (-0.9, -0.5, 0, 0.5, 0.9)
    )
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 380 58" role="img" '
        f'font-family="system-ui,sans-serif" font-size="12">{"".join(cells)}{marks}'
        f'<text x="190" y="53" text-anchor="middle">{text(label)}</text></svg>'
    )
