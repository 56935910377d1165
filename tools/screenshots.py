# SPDX-License-Identifier: Apache-2.0
"""Take the pictures of the viewer that the documentation shows: `make screenshots`.

Plans a shipped part unless its result is there, opens the viewer in a browser without a
screen, and goes through it as a person would.

    python tools/screenshots.py [--out docs/pictures] [--plan out/part1_dome]
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "tools")]

PART = ROOT / "parts" / "part1_dome.stl"
SIZE = {"width": 1200, "height": 760}


def main() -> int:
    """Take every picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "pictures")
    parser.add_argument("--plan", type=Path, default=ROOT / "out" / "part1_dome")
    options = parser.parse_args()
    from playwright.sync_api import sync_playwright
    from setup_browser import FLAGS, find_browser

    path = find_browser()
    if path is None:
        print("screenshots: no Chromium found; run tools/setup_browser.py", file=sys.stderr)
        return 2
    plan = planned(options.plan)
    options.out.mkdir(parents=True, exist_ok=True)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, headless=True, args=list(FLAGS))
        for target, steps in ((PART, of_the_region), (plan, of_the_plan)):
            show(browser, target, steps, options.out)
        browser.close()
    return 0


def planned(folder: Path) -> Path:
    """The result folder of the part, made where it is missing."""
    if not (folder / "summary.json").is_file():
        from vega_planner.pipeline import plan
        from vega_planner.settings import load_settings

        print(f"screenshots: planning {PART.name}", flush=True)
        plan(PART, load_settings(PART.with_suffix(".yaml"))).write(folder)
    return folder


def show(browser: Any, target: Path, steps: Callable[..., None], out: Path) -> None:
    """Open a target and take its pictures."""
    from vega_planner.viewer.server import open_viewer

    with open_viewer(str(target), port=0) as (viewer, url):
        viewer.load()
        page = browser.new_page(viewport=SIZE)
        page.goto(url)
        page.get_by_role("button", name="Plan", exact=True).wait_for()
        notice = page.get_by_text("Software WebGL rendering detected")
        notice.wait_for()
        page.locator(".mantine-Notification-closeButton").first.click()
        settle(3.0)
        steps(viewer, page, out)
        page.close()


def of_the_region(viewer: Any, page: Any, out: Path) -> None:
    """The restraint region, its SPEC, and the layers it leads to."""
    viewer.controls.show_robot.value = False
    come_closer(viewer, 0.6)
    viewer.region.changed()
    while "Working" in viewer.controls.pointed.content:
        settle(0.2)
    save(page, out / "viewer_region.png")


def of_the_plan(viewer: Any, page: Any, out: Path) -> None:
    """The print half-way, and a section through all layers."""
    duration = viewer.result.timeline.duration_s
    viewer.controls.time.value = round(0.75 * duration, 1)
    viewer.set_time(0.75 * duration)
    save(page, out / "viewer_print.png")
    viewer.controls.time.value = viewer.controls.time.max
    viewer.set_time(duration)
    viewer.controls.cut.value = "cut at y"
    viewer.controls.show_robot.value = False
    viewer.controls.show_path.value = False
    viewer.picture.redraw()
    come_closer(viewer, 0.6)
    page.get_by_role("tab", name="Result").click()
    save(page, out / "viewer_section.png")


def come_closer(viewer: Any, share: float) -> None:
    """Move every camera towards the part, to a share of its distance."""
    for client in viewer._server.get_clients().values():
        camera = client.camera
        camera.position = camera.look_at + share * (camera.position - camera.look_at)


def save(page: Any, path: Path) -> None:
    """Wait until the picture stands still, then keep it."""
    settle(4.0)
    page.screenshot(path=str(path))
    print(f"screenshots: {path}", flush=True)


def settle(seconds: float) -> None:
    """Let the browser draw."""
    time.sleep(seconds)


if __name__ == "__main__":
    raise SystemExit(main())
