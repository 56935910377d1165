# SPDX-License-Identifier: Apache-2.0
"""Compare the two layer engines: `field` against the literal `minkowski`, side by side.

python bench/engines.py [--parts NAME,NAME] [--json FILE]
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).resolve().parent.parent)]

from layer_parts import Solid, ball, base, cube, make_part, nothing

from vega_planner.datatypes import Layer, Part
from vega_planner.layers import generate_layers
from vega_planner.layers.distance_field import DistanceField
from vega_planner.layers.minkowski import facet_error_mm
from vega_planner.settings import LayerSettings

T = 0.8


def wedge() -> Solid:
    points = [[0, 0, 0], [12, 0, 0], [12, 8, 0], [0, 8, 0], [0, 0, 7], [0, 8, 7]]
    return Solid.hull_points(np.array(points, float))


def tetra() -> Solid:
    return Solid.hull_points(np.array([[0, 0, 0], [14, 0, 0], [5, 12, 0], [6, 4, 11.0]]))


def curved() -> Part:
    solid = Solid.cylinder(5, 5, 5, 16) - ball(12, 32).translate((0, 0, -11))
    return make_part(
        "curved", solid, lambda n, c: base(n, c) | (np.linalg.norm(c - (0, 0, -11), axis=1) < 12.1)
    )


PARTS: dict[str, Callable[[], Part]] = {
    "box": lambda: make_part("box", cube(12, 10, 6), base),
    "box_full": lambda: make_part("box_full", cube(12, 10, 6), nothing),
    "l_block": lambda: make_part("l_block", cube(12, 8, 4) + cube(5, 8, 9), base),
    "wedge": lambda: make_part("wedge", wedge(), base),
    "tetra": lambda: make_part("tetra", tetra(), base),
    "cylinder": lambda: make_part("cylinder", Solid.cylinder(8, 5, 5, 16), base),
    "cone": lambda: make_part("cone", Solid.cylinder(9, 6, 1, 16), base),
    "two_bodies": lambda: make_part(
        "two_bodies", cube(7, 7, 5) + Solid.cylinder(6, 4, 3, 12).translate((14, 4, 0)), base
    ),
    "channel": lambda: make_part(
        "channel", cube(10, 14, 9) - cube(12, 5, 9).translate((-1, 4.5, 4)), base
    ),
    "curved": curved,
    "dome": lambda: make_part("dome", ball(6, 16).trim_by_plane((0, 0, 1), 0), base),
}


def apart(layer: Layer, other: Layer) -> np.ndarray:
    """Distances from the vertices and face centres of a layer to another [mm]."""
    points = np.concatenate([layer.vertices, layer.vertices[layer.faces].mean(1)])
    return DistanceField(other.vertices, other.faces).distances(points)


def compare(part: Part) -> dict[str, Any]:
    """Make the layers of a part with both engines and measure how far apart they are.

    Only envelopes are compared, layer by layer and from both sides. The oracle's facets
    let it erode too little at concave places, by at most `facet_mm` at the deepest layer.
    """
    start = time.perf_counter()
    field = generate_layers(part, LayerSettings(thickness_mm=T, fill_core=False))
    middle = time.perf_counter()
    literal = generate_layers(part, LayerSettings(thickness_mm=T, engine="minkowski"))
    end = time.perf_counter()
    count = min(len(field.layers), len(literal.layers))
    there = [apart(a, b) for a, b in zip(field.layers, literal.layers)]
    back = [apart(b, a) for a, b in zip(field.layers, literal.layers)]
    distances = np.concatenate(there + back)
    return {
        "part": part.name,
        "faces": len(part.faces),
        "field_layers": len(field.layers),
        "minkowski_layers": len(literal.layers),
        "p99_mm": float(np.quantile(distances, 0.99)),
        "max_mm": float(distances.max()),
        "facet_mm": facet_error_mm(T / 2) + (count - 1) * facet_error_mm(T),
        "field_seconds": middle - start,
        "minkowski_seconds": end - middle,
        "ratio": (end - middle) / (middle - start),
    }


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def main() -> int:
    """Compare the named parts and print a table; 1 if one is off."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--parts", default="", help="names, comma-separated; all if absent")
    parser.add_argument("--json", default="", help="file to write the rows to")
    options = parser.parse_args()
    names = options.parts.split(",") if options.parts else list(PARTS)
    generate_layers(PARTS["box"](), LayerSettings())
    rows = []
    for name in names:
        rows.append(compare(PARTS[name]()))
        texts = (
            f"{k} {v:.4g}" if isinstance(v, float) else f"{k} {v}" for k, v in rows[-1].items()
        )
        print(", ".join(texts), flush=True)
    if options.json:
        Path(options.json).write_text(json.dumps(rows, indent=1), encoding="utf-8")
    return int(any(row["p99_mm"] > 0.03 + row["facet_mm"] for row in rows))


if __name__ == "__main__":
    raise SystemExit(main())
