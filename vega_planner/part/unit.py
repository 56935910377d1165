# SPDX-License-Identifier: Apache-2.0
"""The unit of a file's numbers, stated, told or guessed."""

from __future__ import annotations

from vega_planner.errors import BadMesh

#: Millimetres per unit, by the names that settings and 3MF files use.
MM_PER = {
    **dict.fromkeys(("mm", "millimeter", "millimeters"), 1.0),
    **dict.fromkeys(("cm", "centimeter", "centimeters"), 10.0),
    **dict.fromkeys(("m", "meter", "meters"), 1000.0),
    **dict.fromkeys(("inch", "inches"), 25.4),
    **dict.fromkeys(("foot", "feet"), 304.8),
    **dict.fromkeys(("micron", "microns"), 1e-3),
}

#: Nothing that a bead of a millimetre can make is smaller [mm].
SMALLEST_MM = 1.0
#: Nothing that stands on a robot's table is larger [mm].
LARGEST_MM = 2000.0


def unit_scale(setting: str, stated: str, extent: float) -> tuple[float, list[str]]:
    """Find the factor from a file's numbers to millimetres.

    Args:
        setting: `PartSettings.unit`; anything but "auto" is taken as it is.
        stated: Unit the file states, or empty.
        extent: Longest side of the bounding box in the file's numbers, > 0.

    Returns:
        Millimetres per number, and remarks for the person.

    Raises:
        BadMesh: If the size is absurd in every unit that comes into question.
    """
    how = "set part.unit to mm, cm, m or inch"
    if setting != "auto":
        scale, unit = MM_PER[setting], setting
    elif stated:
        if stated not in MM_PER:
            raise BadMesh(f"unit '{stated}' is not known; {how}")
        scale, unit = MM_PER[stated], stated
    elif extent < SMALLEST_MM <= extent * MM_PER["m"]:
        size = extent * MM_PER["m"]
        return MM_PER["m"], [
            f"unit guessed: the numbers span {extent:.4g}, taken as metres ({size:.4g} mm); "
            f"if that is wrong {how}"
        ]
    else:
        scale, unit = 1.0, "mm"
    size = extent * scale
    if not SMALLEST_MM * 0.1 <= size <= LARGEST_MM:
        raise BadMesh(
            f"size {size:.4g} mm (numbers span {extent:.4g} {unit}); allowed: "
            f"{SMALLEST_MM * 0.1:g} to {LARGEST_MM:g} mm; scale the part or {how}"
        )
    if setting == "auto" and scale != 1.0:
        return scale, [f"unit {unit} read from the file: the part is {size:.4g} mm long"]
    return scale, []
