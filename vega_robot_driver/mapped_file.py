# SPDX-License-Identifier: Apache-2.0
"""A file that two processes map into their memory; it stays readable after either died."""

from __future__ import annotations

import mmap
from pathlib import Path

from vega_planner.errors import LinkTimeout


def map_file(path: Path, size: int, missing: str, *, create: bool) -> mmap.mmap:
    """Map a file for reading and writing.

    Args:
        path: The file.
        size: Its length in bytes.
        missing: What it means that there is none.
        create: Make it anew, all zero.

    Raises:
        LinkTimeout: If there is no such file to open.
    """
    if create:
        path.write_bytes(bytes(size))
    try:
        with path.open("r+b") as file:
            return mmap.mmap(file.fileno(), size)
    except (OSError, ValueError) as error:
        raise LinkTimeout(f"{missing}: {error}") from error
