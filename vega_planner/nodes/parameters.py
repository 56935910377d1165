# SPDX-License-Identifier: Apache-2.0
"""Node parameters from the settings dataclasses: name, default and description exist once."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node

from vega_planner.settings import Settings


def declare_settings(node: Node, section: Any = None, prefix: str = "") -> None:
    """Declare every field of the settings as a parameter, e.g. `layers.thickness_mm`."""
    section = section or Settings()
    for item in fields(section):
        value = getattr(section, item.name)
        if is_dataclass(value):
            declare_settings(node, value, f"{prefix}{item.name}.")
            continue
        default = list(value) if isinstance(value, tuple) else value
        node.declare_parameter(f"{prefix}{item.name}", default, _described(item.metadata, value))


def read_settings(node: Node, section: Any = None, prefix: str = "") -> Settings:
    """Read the parameters back into settings.

    Raises:
        InvalidInput: If a value is out of its range.
    """
    return Settings().updated(_values(node, section or Settings(), prefix))


def _values(node: Node, section: Any, prefix: str) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for item in fields(section):
        value = getattr(section, item.name)
        if is_dataclass(value):
            values[item.name] = _values(node, value, f"{prefix}{item.name}.")
        else:
            values[item.name] = node.get_parameter(f"{prefix}{item.name}").value
    return values


def _described(metadata: Any, value: Any) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(description=metadata.get("doc", ""))
    choices = metadata.get("choices") or ()
    if choices:
        descriptor.additional_constraints = f"one of: {', '.join(choices)}"
    low, high = metadata.get("low"), metadata.get("high")
    if low is None or isinstance(value, bool):
        return descriptor
    if isinstance(value, int):
        descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high))]
    elif isinstance(value, float):
        descriptor.floating_point_range = [
            FloatingPointRange(from_value=float(low), to_value=float(high))
        ]
    return descriptor
