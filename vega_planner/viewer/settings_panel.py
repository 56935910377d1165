# SPDX-License-Identifier: Apache-2.0
"""The settings as input fields, made from their declarations: name, unit, limits, reason."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, is_dataclass
from typing import Any

from vega_planner.settings import Settings

#: Endings of field names and the units they stand for, the longest first.
UNITS = (("_mm_s", "mm/s"), ("_mm", "mm"), ("_deg", "°"), ("_ratio", "bead widths"), ("_s", "s"))


def label_and_unit(name: str) -> tuple[str, str]:
    """Split a field's name into words for a person and its unit, or an empty one."""
    for ending, unit in UNITS:
        if name.endswith(ending):
            return name[: -len(ending)].replace("_", " "), unit
    return name.replace("_", " "), ""


class SettingsPanel:
    """Input fields of all settings but the restraint region."""

    def __init__(self, gui: Any, settings: Settings, on_change: Callable[[], None]) -> None:
        """Make the fields inside the container that is open.

        Args:
            gui: viser's GUI.
            settings: What they show at first, and keep where no field changes it.
            on_change: Called after a person changed a field.
        """
        self._base = settings
        self._inputs: dict[tuple[str, str], Any] = {}
        for section in fields(settings):
            values = getattr(settings, section.name)
            if not is_dataclass(values):
                continue
            with gui.add_folder(section.name, expand_by_default=False):
                for item in fields(values):
                    if item.name == "brr":
                        continue
                    handle = _input(gui, item, getattr(values, item.name))
                    handle.on_update(
                        lambda event: on_change() if event.client_id is not None else None
                    )
                    self._inputs[section.name, item.name] = handle

    def settings(self, brr: tuple[str, ...]) -> Settings:
        """Read the fields.

        Args:
            brr: SPECs of the restraint region.

        Raises:
            InvalidInput: If a value is out of its range.
        """
        changes: dict[str, dict[str, Any]] = {"part": {"brr": brr}}
        for (section, name), handle in self._inputs.items():
            changes.setdefault(section, {})[name] = handle.value
        return self._base.updated(changes)


def _input(gui: Any, item: Any, value: Any) -> Any:
    words, unit = label_and_unit(item.name)
    label = f"{words} [{unit}]" if unit else words
    hint = item.metadata.get("doc", "")
    choices = item.metadata.get("choices") or ()
    if choices:
        return gui.add_dropdown(label, tuple(choices), initial_value=value, hint=hint)
    if isinstance(value, bool):
        return gui.add_checkbox(label, value, hint=hint)
    if isinstance(value, int | float):
        low, high = item.metadata.get("low"), item.metadata.get("high")
        limits = f" {low:g} to {high:g}." if low is not None else ""
        return gui.add_number(label, value, min=low, max=high, hint=hint + limits)
    return gui.add_text(label, str(value), hint=hint)
