# SPDX-License-Identifier: Apache-2.0
"""Set up `.venv` with everything Vega needs. Only what is missing is done.

Needs Python 3.11 or 3.12, g++, cmake, make and git. Where a full ROS 2 is sourced it
is used; elsewhere ROS 2 comes from wheels.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
PYTHON = VENV / "bin" / "python"
STAMPS = VENV / "stamps"
TESTED = ((3, 11), (3, 12))


def main() -> int:
    """Run the steps that are not up to date."""
    if sys.version_info[:2] not in TESTED:
        return _fail(
            f"Python {sys.version.split()[0]} at {sys.executable}; needs 3.11 or 3.12 "
            "(choose one with 'make setup PYTHON=python3.11')"
        )
    for tool in ("g++", "cmake", "make"):
        if not shutil.which(tool):
            return _fail(f"{tool} is not installed (Debian: apt-get install g++ cmake make git)")
    began = time.monotonic()
    try:
        _make_venv()
        _install_packages()
        _install_vega()
        _compile_bytecode()
        _build_kernels()
    except subprocess.CalledProcessError as error:
        return _fail(f"'{' '.join(map(str, error.cmd))}' ended with status {error.returncode}")
    taken = time.monotonic() - began
    if taken > 5:
        print(f"setup: done in {taken:.0f} s", flush=True)
    return 0


def full_ros() -> bool:
    """Tell whether a full ROS 2 is sourced in this shell."""
    return bool(os.environ.get("ROS_DISTRO")) and bool(shutil.which("ros2"))


def _make_venv() -> None:
    if PYTHON.exists() and _ok([PYTHON, "-m", "pip", "--version"]):
        return
    _say("making .venv")
    base = [sys.executable, "-m", "venv", "--clear"]
    if full_ros():
        base.append("--system-site-packages")
    if subprocess.run(
        [*base, VENV], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ).returncode:
        # Debian splits ensurepip off; the system's own pip can still fill the folder.
        _run([*base, "--without-pip", VENV])
        if not _ok([sys.executable, "-m", "pip", "--version"]):
            raise SystemExit(
                _fail("neither venv nor pip is there (Debian: apt-get install python3-venv)")
            )
        _run([sys.executable, "-m", "pip", "--python", PYTHON, "install", "-q", "pip"])


def _install_packages() -> None:
    locks = [ROOT / "requirements" / "planner.lock"]
    if not full_ros():
        locks.append(ROOT / "requirements" / "ros.lock")
    if _current("packages", locks):
        return
    _say("installing the pinned packages (about two minutes)")
    words = [word for lock in locks for word in ("-r", lock)]
    _run(
        [PYTHON, "-m", "pip", "install", "-q", "--disable-pip-version-check",
         "--no-warn-script-location", *words]
    )  # fmt: skip
    _mark("packages", locks)


def _install_vega() -> None:
    """Make the messages, and install the packages so that edits are seen at once."""
    _run([PYTHON, ROOT / "tools" / "setup_ros.py"])


def _compile_bytecode() -> None:
    """Also where Python is told not to write it by itself: a start is 0.2 s sooner."""
    rooms = sorted(path for path in ROOT.glob("vega_*") if path.is_dir())
    _run([PYTHON, "-m", "compileall", "-q", *rooms])


def _build_kernels() -> None:
    builder = ROOT / "tools" / "build_kernels.py"
    if not _ok([PYTHON, builder, "--check"]):
        _say("compiling kernels (about a minute)")
        _run([PYTHON, builder])


def _digest(files: Sequence[Path]) -> str:
    total = hashlib.sha256(sys.version.encode())
    for file in files:
        total.update(str(file).encode())
        total.update(file.read_bytes())
    return total.hexdigest()


def _current(name: str, files: Sequence[Path]) -> bool:
    stamp = STAMPS / name
    return stamp.exists() and stamp.read_text() == _digest(files)


def _mark(name: str, files: Sequence[Path]) -> None:
    STAMPS.mkdir(parents=True, exist_ok=True)
    (STAMPS / name).write_text(_digest(files))


def _run(command: Sequence[str | Path]) -> None:
    subprocess.run([str(word) for word in command], check=True, cwd=ROOT)


def _ok(command: Sequence[str | Path]) -> bool:
    words = [str(word) for word in command]
    return subprocess.run(words, capture_output=True, cwd=ROOT).returncode == 0


def _say(text: str) -> None:
    print(f"setup: {text}", flush=True)


def _fail(text: str) -> int:
    print(f"setup: {text}", file=sys.stderr)
    return 2


if __name__ == "__main__":
    raise SystemExit(main())
