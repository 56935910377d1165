# SPDX-License-Identifier: Apache-2.0
"""The conformal substrate as a file for an ordinary printer."""

from __future__ import annotations

from pathlib import Path

from vega_planner.datatypes import Part
from vega_planner.errors import InvalidInput
from vega_planner.results.folder import check_output_folder, write_folder
from vega_planner.results.stl import mesh_stl
from vega_planner.substrate import make_substrate, stands_flat


def write_substrate(part: Part, path: str | Path, clearance_mm: float | None = None) -> Path:
    """Write the substrate of a part as binary STL, in the part frame [mm].

    Args:
        part: The part, lowest point on z = 0; the substrate's foot is below.
        path: File to write.
        clearance_mm: Gap between part and substrate; the default's where absent.

    Returns:
        The file's absolute path.

    Raises:
        InvalidInput: If the part stands flat and needs none, or a value is out of range.
        OutputError: If the file cannot be written.
    """
    target = Path(path).absolute()
    if target.suffix.lower() != ".stl":
        raise InvalidInput(f"substrate file {path} ends in '{target.suffix}'; choices: .stl")
    if stands_flat(part):
        raise InvalidInput(f"part '{part.name}' has a planar base and needs no substrate")
    check_output_folder(target.parent)
    changes = {} if clearance_mm is None else {"clearance_mm": clearance_mm}
    write_folder(target.parent, {target.name: mesh_stl(make_substrate(part, **changes))})
    return target
