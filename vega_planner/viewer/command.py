# SPDX-License-Identifier: Apache-2.0
"""The command line that does again what was clicked together."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from vega_planner.errors import OutputError
from vega_planner.settings import Settings, as_dict

#: Settings that have an option of their own.
OPTIONS = {
    "layers.thickness_mm": "--thickness",
    "toolpaths.width_mm": "--width",
    "trajectory.speed_mm_s": "--speed",
    "layers.engine": "--engine",
    "toolpaths.pattern": "--pattern",
    "toolpaths.angle_deg": "--angle",
    "toolpaths.spacing": "--spacing",
    "printability.orientation": "--orientation",
    "cell.robot": "--robot",
    "cell.tool": "--tool",
    "cell.material": "--material",
    "cell.pose": "--pose",
}


def differences(settings: Settings, base: Settings) -> dict[str, Any]:
    """List the settings that differ from others, by "section.key"; the region left out."""
    mine, theirs = _flat(settings), _flat(base)
    return {key: value for key, value in mine.items() if value != theirs[key]}


def plan_command(
    source: str,
    out: str,
    specs: Sequence[str],
    settings: Settings,
    base: Settings,
    settings_file: Path | None,
    own_file: Path,
) -> str:
    """Print the command that plans the same.

    Args:
        source: Mesh file.
        out: Result folder.
        specs: SPECs of the restraint region.
        settings: What to plan with.
        base: What the settings file holds, or the defaults.
        settings_file: The settings file, where there is one.
        own_file: Where `save_settings` puts what has no option of its own.

    Returns:
        A command for a shell, one option a line.
    """
    words = [["vega", "plan", source], ["-o", out]]
    changed = differences(settings, base)
    if needs_file(settings, base):
        words.append(["--settings", str(own_file)])
        changed = {}
    elif settings_file is not None:
        words.append(["--settings", str(settings_file)])
    for spec in specs:
        words.append(["--brr", spec])
    for key, value in changed.items():
        # Joined with "=", so that a negative number does not look like an option.
        text = f"{value:g}" if isinstance(value, float) else str(value)
        words.append([f"{OPTIONS[key]}={text}"] if text[:1] == "-" else [OPTIONS[key], text])
    return " \\\n  ".join(shlex.join(group) for group in words)


def needs_file(settings: Settings, base: Settings) -> bool:
    """Tell whether something changed that no option can say."""
    return any(key not in OPTIONS for key in differences(settings, base))


def save_settings(settings: Settings, path: Path) -> None:
    """Write a settings file.

    Raises:
        OutputError: If it cannot be written.
    """
    import yaml

    values = as_dict(settings)
    values["part"].pop("brr")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(yaml.safe_dump(values, sort_keys=False), encoding="utf-8")
    except OSError as error:
        raise OutputError(f"{path} cannot be written: {error.strerror}") from error


def _flat(settings: Settings) -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for section, value in as_dict(settings).items():
        if isinstance(value, dict):
            flat |= {f"{section}.{key}": item for key, item in value.items() if key != "brr"}
        else:
            flat[section] = value
    return flat
