# SPDX-License-Identifier: Apache-2.0
"""Take the pictures of the viewer that the documentation shows: `make screenshots`.

Plans a shipped part unless its result is there, opens the viewer in a browser without a
screen, and goes through it as a person would.

    python tools/screenshots.py [--out docs/pictures] [--plan out/part1_dome] [--part PART]
"""

from __future__ import annotations

import argparse
import io
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "tools")]

#: From the repository's root, so that the command in the picture is short.
PART = Path("parts/part1_dome.stl")
SIZE = {"width": 1100, "height": 680}
#: Longest time until the picture stands still [s].
PATIENCE_S = 30.0


def main() -> int:
    """Take every picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "pictures")
    parser.add_argument("--plan", type=Path, default=ROOT / "out" / "part1_dome")
    parser.add_argument("--part", type=Path, default=PART, help="mesh whose region is chosen")
    options = parser.parse_args()
    from playwright.sync_api import sync_playwright
    from setup_browser import FLAGS, find_browser

    path = find_browser()
    if path is None:
        print("screenshots: no Chromium found; run tools/setup_browser.py", file=sys.stderr)
        return 2
    out, plan = options.out.absolute(), options.plan.absolute()
    part = options.part if options.part == PART else options.part.absolute()
    os.chdir(ROOT)
    planned(plan)
    out.mkdir(parents=True, exist_ok=True)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, headless=True, args=list(FLAGS))
        for target, steps in ((part, of_the_region), (plan, of_the_plan)):
            show(browser, target, steps, out)
        browser.close()
    return 0


def planned(folder: Path) -> None:
    """Make the result folder of the part where it is missing."""
    if not (folder / "summary.json").is_file():
        from vega_planner.pipeline import plan
        from vega_planner.settings import load_settings

        print(f"screenshots: planning {PART.name}", flush=True)
        plan(PART, load_settings(PART.with_suffix(".yaml"))).write(folder)


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
        until(lambda: viewer.picture.has_robot)
        steps(viewer, page, out)
        page.close()


def of_the_region(viewer: Any, page: Any, out: Path) -> None:
    """The restraint region, its SPEC, and the layers it leads to."""
    viewer.controls.show_robot.value = False
    viewer.picture.refresh()
    viewer.region.changed()
    until(lambda: "Working" not in viewer.controls.pointed.content)
    save(page, out / "viewer_region.png")


def of_the_plan(viewer: Any, page: Any, out: Path) -> None:
    """A section through all layers, and the print in progress."""
    controls, picture = viewer.controls, viewer.picture
    controls.cut.value = "cut at y"
    controls.show_robot.value = False
    picture.redraw()
    page.get_by_role("tab", name="Result").click()
    save(page, out / "viewer_plan.png")
    controls.cut.value = "whole"
    controls.show_robot.value = True
    picture.redraw()
    step_back(viewer, 1.5)
    time_s = seen_from_beside(viewer)
    controls.time.value = time_s
    viewer.set_time(time_s)
    page.get_by_role("tab", name="Show").click()
    save(page, out / "viewer_print.png")


def seen_from_beside(viewer: Any) -> float:
    """A time in the third quarter at which the nozzle stands to the left of the part [s]."""
    camera = viewer._server.initial_camera
    ahead = np.subtract(camera.look_at, camera.position)
    right = np.cross(ahead, (0.0, 0.0, 1.0))
    timeline = viewer.picture.result.timeline
    times = np.round(np.linspace(0.5, 0.75, 60) * timeline.duration_s, 1).tolist()
    return min(
        times, key=lambda t: (not timeline.at(t).dispensing, np.dot(timeline.at(t).axis, right))
    )


def step_back(viewer: Any, times: float) -> None:
    """Move every camera away from what it looks at, so many times as far."""
    for client in viewer._server.get_clients().values():
        camera = client.camera
        camera.position = camera.look_at + times * (camera.position - camera.look_at)


def save(page: Any, path: Path) -> None:
    """Wait until the picture stands still, then keep it."""
    from PIL import Image

    time.sleep(1.0)
    shots = [page.screenshot()]
    end = time.monotonic() + PATIENCE_S
    while len(shots) < 4 or len(set(shots[-3:])) > 1:
        if time.monotonic() > end:
            break
        time.sleep(0.6)
        shots.append(page.screenshot())
    Image.open(io.BytesIO(shots[-1])).convert("RGB").save(path, optimize=True)
    print(f"screenshots: {path}", flush=True)


def until(claim: Callable[[], bool]) -> None:
    """Wait until a claim holds."""
    end = time.monotonic() + PATIENCE_S
    while not claim():
        if time.monotonic() > end:
            raise SystemExit("screenshots: waited in vain")
        time.sleep(0.1)


if __name__ == "__main__":
    raise SystemExit(main())
