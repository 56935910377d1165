# SPDX-License-Identifier: Apache-2.0
"""Writing of a result folder's trajectory in a controller's language."""

from __future__ import annotations

from pathlib import Path

from vega_planner.errors import InvalidInput
from vega_planner.results.folder import output_errors

#: Formats by name, with the suffix of their files.
FORMATS = {"gcode": ".gcode", "urscript": ".script", "csv": ".csv"}


def export_plan(
    folder: str | Path,
    format: str,
    output: str | Path | None = None,
    robot: str | None = None,
) -> Path:
    """Write the trajectory of a result folder for a machine's controller.

    Args:
        folder: Result folder of a plan.
        format: "gcode", "urscript" or "csv". G-code comes as two files: tip coordinates
            with rotary words, and beside it, with `_joints` in its name, axis positions.
        output: File to write; `print` with the format's suffix in the folder by default.
        robot: Name or path of the robot; by default the one the result names.

    Returns:
        The file written.

    Raises:
        InvalidInput: If the folder, the format, or the robot for this format is wrong.
        OutputError: If the file cannot be written.
    """
    if format not in FORMATS:
        raise InvalidInput(f"format is '{format}'; choices: {', '.join(FORMATS)}")
    from vega_planner.export.job import read_result

    job = read_result(folder, robot)
    path = Path(output) if output else Path(folder) / f"print{FORMATS[format]}"
    if path.is_dir():
        raise InvalidInput(f"output {path} is a folder; expected a file")
    files: dict[Path, str]
    if format == "gcode":
        from vega_planner.export.gcode import write_gcode

        joints = path.with_name(f"{path.stem}_joints{path.suffix}")
        files = {path: write_gcode(job, "tip"), joints: write_gcode(job, "joints")}
    elif format == "urscript":
        from vega_planner.export.urscript import write_urscript

        files = {path: write_urscript(job)}
    else:
        from vega_planner.export.csv_table import write_csv

        files = {path: write_csv(job)}
    with output_errors(path):
        for name, text in files.items():
            _write_whole(name, text)
    return path.absolute()


def _write_whole(path: Path, text: str) -> None:
    """Write a file so that it is never seen half-written."""
    draft = path.with_name(f".{path.name}.part")
    try:
        draft.write_text(text, encoding="utf-8")
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)
