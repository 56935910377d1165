# SPDX-License-Identifier: Apache-2.0
"""Where the files that ship with the package lie: config/, urdf/, launch/, rviz/, parts/.

In the source tree they stand beside the package; installed, in `share/vega` of the prefix.
"""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

from vega_planner.errors import InvalidInput

_MARKER = Path("config") / "robots"


@cache
def share_folder() -> Path:
    """Find the folder that holds config/, urdf/ and the other shipped files.

    Raises:
        InvalidInput: If there is none, naming the places that were looked at.
    """
    package = Path(__file__).resolve().parent
    places = [package.parent]
    places += [parent / "share" / "vega" for parent in Path(__file__).absolute().parents]
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    places += [Path(prefix) / "share" / "vega" for prefix in prefixes if prefix]
    for place in places:
        if (place / _MARKER).is_dir():
            return place
    raise InvalidInput(
        f"the shipped folder '{_MARKER}' is in none of: {', '.join(map(str, places))}"
    )


def shared_file(*parts: str) -> Path:
    """Build the path of a shipped file, e.g. `shared_file("config", "tools", "x.yaml")`."""
    return share_folder().joinpath(*parts)


def choices(*folder: str) -> tuple[str, ...]:
    """List the names of the YAML files in a shipped folder, without suffix, sorted."""
    return tuple(sorted(path.stem for path in shared_file(*folder).glob("*.yaml")))


def named_file(kind: str, spec: str, *folder: str) -> Path:
    """Resolve a setting that is the name of a shipped YAML file, or a path.

    Args:
        kind: What the file describes, for the error text.
        spec: A name out of `choices(*folder)`, or the path of a file.
        folder: The shipped folder of such files.

    Raises:
        InvalidInput: If it is neither.
    """
    path = Path(spec).expanduser()
    if path.is_file():
        return path
    if path.name == spec and spec in choices(*folder):
        return shared_file(*folder, f"{spec}.yaml")
    raise InvalidInput(
        f"{kind} '{spec}' is neither a file nor one of: {', '.join(choices(*folder))}"
    )
