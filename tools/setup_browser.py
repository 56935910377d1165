# SPDX-License-Identifier: Apache-2.0
"""Find a Chromium for the viewer's tests and screenshots; install Debian's where there is none.

Does nothing where a browser is found. Needs root to install.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from functools import cache
from pathlib import Path

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
#: What makes WebGL work without a graphics card, and keeps the browser from asking outside.
FLAGS = (
    "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--use-gl=angle", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist",
)  # fmt: skip


@cache
def find_browser() -> str | None:
    """Path of a Chromium or Chrome that runs, or None.

    The variable VEGA_BROWSER names one; otherwise the search path and playwright's own
    downloads are looked through. Ubuntu's chromium-browser, which only asks for snap,
    does not count.
    """
    chosen = os.environ.get("VEGA_BROWSER")
    found = [chosen] if chosen else [path for name in NAMES if (path := shutil.which(name))]
    home = Path(os.environ.get("PLAYWRIGHT_BROWSERS_PATH", Path.home() / ".cache/ms-playwright"))
    found += [str(path) for path in sorted(home.glob("chromium-*/chrome-linux*/chrome"))]
    return next((path for path in found if _runs(path)), None)


def _runs(path: str) -> bool:
    try:
        shown = subprocess.run([path, "--version"], capture_output=True, text=True, timeout=60)
    except (OSError, subprocess.TimeoutExpired):
        return False
    return shown.returncode == 0 and "Chrom" in shown.stdout


def main() -> int:
    """Find or install."""
    if find_browser():
        return 0
    if os.geteuid() != 0 or not shutil.which("apt-get") or _only_snap():
        print(
            "setup: no Chromium found for the viewer's tests; install one "
            "(Debian: apt-get install chromium; elsewhere: "
            ".venv/bin/python -m playwright install --with-deps chromium), "
            "or name one in VEGA_BROWSER",
            file=sys.stderr,
        )
        return 2
    print("setup: installing Chromium for the viewer's tests", flush=True)
    quiet = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    for words in (["update"], ["install", "-y", "--no-install-recommends", "chromium"]):
        done = subprocess.run(
            ["apt-get", "-qq", *words], env=quiet, capture_output=True, text=True
        )
    if done.returncode:
        lines = done.stderr.strip().splitlines() or ["no reason given"]
        print(f"setup: apt-get could not install chromium: {lines[-1]}", file=sys.stderr)
        return 2
    find_browser.cache_clear()
    if not find_browser():
        print("setup: chromium was installed and does not run", file=sys.stderr)
        return 2
    return 0


def _only_snap() -> bool:
    """Ubuntu's package of that name is only a door to snap."""
    release = Path("/etc/os-release")
    return release.is_file() and "ID=ubuntu" in release.read_text().splitlines()


if __name__ == "__main__":
    raise SystemExit(main())
