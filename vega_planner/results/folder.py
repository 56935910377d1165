# SPDX-License-Identifier: Apache-2.0
"""Writing a result folder so that it is either whole or not there."""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from vega_planner.errors import InvalidInput, OutputError


@contextlib.contextmanager
def output_errors(out: Path) -> Iterator[None]:
    """Turn failures of the file system into one `OutputError` that names the folder."""
    try:
        yield
    except OSError as error:
        if isinstance(error, OutputError):
            raise
        reason = {
            errno.ENOSPC: "no space left on the device",
            errno.EDQUOT: "disk quota exceeded",
            errno.EACCES: "permission denied",
            errno.EROFS: "the file system is read-only",
        }.get(error.errno or 0, error.strerror or str(error))
        raise OutputError(f"output {out} cannot be written: {reason}") from error


def check_output_folder(out: str | Path) -> Path:
    """Refuse an output path early, before an hour of work is lost to it.

    Returns:
        The absolute path.

    Raises:
        InvalidInput: If it is a file, or lies below one.
        OutputError: If its place is not writable.
    """
    path = Path(out).absolute()
    for place in (path, *path.parents):
        if place.exists():
            if not place.is_dir():
                raise InvalidInput(f"output {out} is not a folder: {place} is a file")
            if not os.access(place, os.W_OK | os.X_OK):
                raise OutputError(f"output {out} cannot be written: permission denied")
            break
    return path


def write_folder(
    out: str | Path,
    files: Mapping[str, bytes | Callable[[], bytes]],
    obsolete: tuple[str, ...] = (),
) -> Path:
    """Write a set of files into a folder, all or none.

    Everything is written beside the folder first. Where the folder exists, entries
    that this call writes are replaced, and others stay.

    Args:
        out: Folder to write.
        files: Contents, or functions that make them, by path relative to the folder.
            A path's first part names a managed entry: a sub-folder is replaced whole.
        obsolete: Entries of an earlier result that go, should they be there.

    Returns:
        The folder's absolute path.

    Raises:
        OutputError: If something cannot be written; the folder is then as it was.
    """
    path = check_output_folder(out)
    with staged_folder(path, obsolete) as new:
        for name, content in files.items():
            target = new / name
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(content if isinstance(content, bytes) else content())
    return path


@contextlib.contextmanager
def staged_folder(out: str | Path, obsolete: tuple[str, ...] = ()) -> Iterator[Path]:
    """Give a folder to fill, whose entries move into `out` when the block ends well.

    Args:
        out: Folder to write.
        obsolete: Entries of an earlier result that go, should they be there.

    Yields:
        An empty folder beside `out`; it goes when the block raises.

    Raises:
        OutputError: If something cannot be written; `out` is then as it was.
    """
    path = check_output_folder(out)
    with output_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        staging = Path(tempfile.mkdtemp(prefix=f".{path.name}-", dir=path.parent))
        try:
            (staging / "new").mkdir()
            yield staging / "new"
            _move_in(staging, path, obsolete)
        finally:
            shutil.rmtree(staging, ignore_errors=True)


def _move_in(staging: Path, path: Path, obsolete: tuple[str, ...]) -> None:
    """Swap the new entries in, and the old ones back if that fails half-way."""
    new, old = staging / "new", staging / "old"
    if not path.exists():
        new.chmod(0o755)
        new.rename(path)
        return
    old.mkdir()
    entries = sorted(item.name for item in new.iterdir())
    done: list[str] = []
    try:
        for entry in [*entries, *(name for name in obsolete if name not in entries)]:
            done.append(entry)
            if (path / entry).exists():
                (path / entry).rename(old / entry)
            if (new / entry).exists():
                (new / entry).rename(path / entry)
    except OSError:
        for entry in done:
            if (path / entry).exists():
                (path / entry).rename(new / entry)
            if (old / entry).exists():
                (old / entry).rename(path / entry)
        raise
