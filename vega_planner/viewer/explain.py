# SPDX-License-Identifier: Apache-2.0
"""What lies under the pointer, in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vega_planner.datatypes import REASON_CODES, Floats, Ints, Layer, Part
from vega_planner.viewer.picking import first_hit
from vega_planner.viewer.section import Cut

#: What the codes mean, for a person.
MEANINGS = {
    "out_of_travel": "the robot does not reach it",
    "wrist_limit": "the wrist cannot turn that far",
    "own_layer": "the nozzle would touch the layer it prints",
    "printed_part": "the nozzle would touch what is printed before",
    "plate": "the nozzle would touch the build plate",
    "substrate": "the nozzle would touch the substrate",
    "robot_body": "a link of the robot would touch plate, substrate or print",
    "no_support": "nothing is below that could carry it",
}


@dataclass(frozen=True)
class Explanation:
    """What a ray meets.

    Attributes:
        text: For a person, one or two sentences.
        label: The same in a few words.
        point: Where [mm], part frame.
    """

    text: str
    label: str
    point: tuple[float, float, float]


def explain(
    origin: Floats,
    direction: Floats,
    part: Part | None,
    sheets: Sequence[Layer],
    reasons: Sequence[Ints],
    summary: dict[str, Any],
    cut: Cut | None = None,
) -> Explanation | None:
    """Say what is under the pointer: a layer and why it cannot be printed, or the part.

    Args:
        origin: Start of the ray [mm], part frame.
        direction: Its direction.
        part: The part where it is shown, else None.
        sheets: The layers that are shown.
        reasons: By the layers' indices, 0 where printable, else 1 + index into
            `REASON_CODES`.
        summary: Content of `summary.json`, for the remedies.
        cut: Where the layers are cut open.

    Returns:
        None where the ray meets nothing.
    """
    best: tuple[float, Explanation] | None = None
    for sheet in sheets:
        if not _near(origin, direction, sheet.vertices):
            continue
        seen = np.arange(len(sheet.faces)) if cut is None else np.flatnonzero(cut.keeps(sheet))
        hit = first_hit(origin, direction, sheet.vertices, sheet.faces[seen])
        if hit is not None and (best is None or hit.distance < best[0]):
            face = int(seen[hit.face])
            code = int(reasons[sheet.index][face])
            text = _of_layer(sheet, face, code, summary)
            state = REASON_CODES[code - 1].replace("_", " ") if code else "printable"
            label = f"layer {sheet.index}: {state}"
            best = hit.distance, Explanation(text, label, hit.point)
    if part is not None:
        hit = first_hit(origin, direction, part.vertices, part.faces)
        if hit is not None and (best is None or hit.distance < best[0] - 1e-3):
            text = _of_part(part, hit.face)
            best = hit.distance, Explanation(text, f"face {hit.face}", hit.point)
    return best[1] if best else None


def _of_layer(sheet: Layer, face: int, code: int, summary: dict[str, Any]) -> str:
    thickness = sheet.thickness[sheet.faces[face]].mean()
    where = "height" if sheet.kind == "planar" else "depth"
    text = (
        f"{sheet.kind} layer {sheet.index}, {where} {sheet.depth_mm:.2f} mm, "
        f"{thickness:.2f} mm thick: "
    )
    if code == 0:
        return text + "printable"
    name = REASON_CODES[code - 1]
    text += f"**{name}**, {MEANINGS[name]}"
    remedy = _remedy(name, sheet.index, summary)
    return f"{text}. {remedy}" if remedy else text


def _remedy(code: str, layer: int, summary: dict[str, Any]) -> str:
    reasons = summary.get("printability", {}).get("reasons", [])
    matching = [reason for reason in reasons if reason.get("code") == code]
    own = [reason for reason in matching if reason.get("layer") in (layer, -1)]
    found = (own or matching or [{}])[0]
    return str(found.get("remedy", ""))


def _of_part(part: Part, face: int) -> str:
    lean = np.degrees(np.arccos(np.clip(part.face_normals[face][2], -1, 1)))
    state = "in the restraint region" if part.restrained[face] else "buffered"
    return f"face {face} of the part, {lean:.0f}° from upward, {state}"


def _near(origin: Floats, direction: Floats, vertices: Floats) -> bool:
    """Whether a ray passes the bounding ball of points; spares most of the layers."""
    middle = (vertices.min(0) + vertices.max(0)) / 2
    radius = np.linalg.norm(vertices.max(0) - vertices.min(0)) / 2
    along = direction / np.linalg.norm(direction)
    offset = middle - origin
    return bool(np.linalg.norm(offset - (offset @ along) * along) <= radius)
