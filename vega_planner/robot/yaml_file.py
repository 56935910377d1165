# SPDX-License-Identifier: Apache-2.0
"""Reading of the small YAML files of robots, tools and materials, with clear errors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from vega_planner.errors import BadRobot


def read_mapping(path: Path, kind: str, known: tuple[str, ...]) -> dict[str, Any]:
    """Read a YAML file that holds one mapping.

    Args:
        path: The file.
        kind: What it describes, for error texts.
        known: Keys that may stand in it.

    Raises:
        BadRobot: If it cannot be read, is no mapping, or has an unknown key.
    """
    import yaml

    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    try:
        content = yaml.load(path.read_text(encoding="utf-8"), Loader=loader)
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        reason = str(error).splitlines()[0]
        raise BadRobot(f"{kind} file {path} cannot be read: {reason}") from error
    if not isinstance(content, dict):
        raise BadRobot(f"{kind} file {path} holds no keys and values")
    unknown = sorted(set(map(str, content)) - set(known))
    if unknown:
        raise BadRobot(f"{kind} file {path}: unknown key '{unknown[0]}'; has: {', '.join(known)}")
    return content


def number(content: dict[str, Any], key: str, where: str, default: float | None = None) -> float:
    """Take a finite number out of a mapping: plain, or as `{value: 1.0, assumed: true}`.

    Raises:
        BadRobot: If it is missing without a default, or is no finite number.
    """
    value = content.get(key, default)
    if isinstance(value, dict):
        value = value.get("value")
    if isinstance(value, bool) or not isinstance(value, int | float) or abs(value) > 1e9:
        raise BadRobot(f"{where}: '{key}' is {value!r}; expected a number")
    if value != value:
        raise BadRobot(f"{where}: '{key}' is not a number")
    return float(value)


def numbers(
    content: dict[str, Any], key: str, where: str, count: int | None = None
) -> list[float]:
    """Take a list of finite numbers out of a mapping.

    Raises:
        BadRobot: If it is missing, not a list of numbers, or of another length.
    """
    values = content.get(key)
    if not isinstance(values, list) or (count is not None and len(values) != count):
        wanted = "a list of numbers" if count is None else f"a list of {count} numbers"
        raise BadRobot(f"{where}: '{key}' is {values!r}; expected {wanted}")
    return [number({key: value}, key, where) for value in values]
