# SPDX-License-Identifier: Apache-2.0
"""A sample result, the real nodes, and a real browser."""

import importlib.util
import os
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

from vega_planner.viewer.job import LocalJob
from vega_planner.viewer.server import open_viewer

ROOT = Path(__file__).resolve().parents[2]
SMALL = {"layers": 5, "faces_per_layer": 900, "points_per_layer": 600}


def load_module(path):
    """A script of the repository as a module."""
    name = f"_{path.stem}"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, path)
        sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])
    return sys.modules[name]


@pytest.fixture(scope="session")
def sample(tmp_path_factory):
    """A small result folder."""
    writer = load_module(ROOT / "bench" / "sample_plan.py")
    return writer.write_sample(tmp_path_factory.mktemp("sample") / "dome", **SMALL)


@pytest.fixture(scope="session")
def browser():
    """Chromium with software rendering."""
    from playwright.sync_api import sync_playwright

    tool = load_module(ROOT / "tools" / "setup_browser.py")
    path = tool.find_browser()
    assert path, "no Chromium found; tools/setup_browser.py installs one"
    with sync_playwright() as playwright:
        running = playwright.chromium.launch(
            executable_path=path, headless=True, args=list(tool.FLAGS)
        )
        yield running
        running.close()


class Tab:
    """A browser tab that keeps a record of what went wrong in it."""

    def __init__(self, browser, url):
        self.page = browser.new_page(viewport={"width": 800, "height": 600})
        self.problems, self.outside = [], []
        self.page.on("console", self._note)
        self.page.on("pageerror", lambda error: self.problems.append(str(error)))
        self.page.on("request", lambda request: self._watch(request.url))
        self.page.on("websocket", lambda socket: self._watch(socket.url))
        self._url = url
        self.page.goto(url)

    def _note(self, message):
        if message.type == "error":
            self.problems.append(message.text)

    def _watch(self, address):
        inside = (self._url, self._url.replace("http:", "ws:"), "data:", "blob:")
        if not address.startswith(inside):
            self.outside.append(address)

    def button(self, name):
        return self.page.get_by_role("button", name=name, exact=True)

    def press(self, name):
        self.button(name).click()

    def says(self, text):
        self.page.get_by_text(text).first.wait_for(timeout=30_000)

    def assert_clean(self):
        assert self.problems == []
        assert self.outside == []


@pytest.fixture
def open_tabs(browser):
    """Opens viewers with tabs; every tab must end without errors or outside requests."""
    tabs = []

    @contextmanager
    def opened(target, job=None):
        with open_viewer(str(target), port=0, make_job=lambda: job or LocalJob()) as (
            viewer,
            url,
        ):
            viewer.load()

            def new_tab():
                tabs.append(Tab(browser, url))
                return tabs[-1]

            yield viewer, new_tab
            for tab in tabs:
                tab.assert_clean()
                tab.page.close()

    return opened


def until(claim, seconds=30.0):
    """Wait until a claim holds."""
    end = time.monotonic() + seconds
    while not claim():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.02)


@pytest.fixture(name="until")
def _until():
    return until


@pytest.fixture
def real_job(monkeypatch):
    """Plans and prints through the real nodes, on this machine only."""
    from vega_planner.nodes.viewer_port import RosJob

    # All that this process and its nodes say stays in one domain, whoever joined ROS first.
    if "ROS_DOMAIN_ID" not in os.environ:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    port = RosJob()
    yield port
    port.close()
