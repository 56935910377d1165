# SPDX-License-Identifier: Apache-2.0
"""What `vega view` is asked to show: a result folder, or a mesh with its settings."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from vega_planner.errors import InvalidInput
from vega_planner.settings import Settings, load_settings
from vega_planner.viewer.result_folder import result_settings


@dataclass(frozen=True)
class Target:
    """A result folder or a mesh file.

    Attributes:
        path: The folder or file.
        is_result: True for a result folder.
        settings: What it is planned with: the settings file's values, or the defaults.
        settings_file: YAML file beside the mesh, or of the result, where there is one.
        out: Result folder that a plan goes to.
    """

    path: Path
    is_result: bool
    settings: Settings
    settings_file: Path | None
    out: Path

    @property
    def name(self) -> str:
        """Short name for headings and files."""
        return self.path.stem if not self.is_result else self.path.name

    @property
    def source(self) -> Path:
        """Mesh that a plan starts from; of a result, the part as it was planned."""
        return self.path / "part.ply" if self.is_result else self.path

    @property
    def own_settings(self) -> Settings:
        """The settings for `source`: a result's part is in millimetres, and moved already."""
        if not self.is_result:
            return self.settings
        unit = self.settings.part.unit
        unit = unit if unit in ("auto", "mm") else "mm"
        return self.settings.updated({"part": {"unit": unit}, "compensate": ""})


def find_target(target: str) -> Target:
    """Tell what a word of the command line names.

    Raises:
        InvalidInput: If it is neither a mesh file nor a result folder, or its settings
            cannot be read.
    """
    path = Path(target).expanduser()
    if path.is_dir():
        if not (path / "summary.json").is_file() or not (path / "part.ply").is_file():
            raise InvalidInput(
                f"folder {target} is no result folder: it has no summary.json and part.ply; "
                "choices: the OUT of 'vega plan', or a mesh file"
            )
        settings, file = result_settings(path)
        return Target(path, True, settings, file, path)
    if not path.is_file():
        raise InvalidInput(f"there is no {target}; choices: a result folder, or a mesh file")
    beside = path.with_suffix(".yaml")
    found = beside if beside.is_file() else None
    settings = load_settings(found) if found else Settings()
    return Target(path, False, settings, found, Path("out") / path.stem)
