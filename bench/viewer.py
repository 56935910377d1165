# SPDX-License-Identifier: Apache-2.0
"""Measure the viewer with a large plan in a browser without a graphics card.

Prints JSON: seconds to the first picture, to load 20 layers of 10,000 triangles with
200,000 waypoints, frames per second while turning, answers to slider and click, and the
memory of the server. The browser runs at 800 x 600.

    python bench/viewer.py [--out FILE]
"""

from __future__ import annotations

import argparse
import json
import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "bench"), str(ROOT / "tools")]

import sample_plan
import setup_browser
from playwright.sync_api import sync_playwright

from vega_planner.datatypes import Toolpath, ToolpathSet, Travel
from vega_planner.viewer.picking import first_hit
from vega_planner.viewer.result_folder import read_result
from vega_planner.viewer.server import open_viewer

#: How often a page is opened in a browser that has shown one already.
OPENED = 3

#: Counts pictures from inside the page, and the most corners that one picture was made of.
WATCH = """
  window.__frames = 0; window.__corners = 0; window.__most = 0;
  const proto = WebGL2RenderingContext.prototype;
  const clear = proto.clear;
  proto.clear = function(mask) {
    window.__frames++;
    window.__most = Math.max(window.__most, window.__corners);
    window.__corners = 0;
    return clear.call(this, mask);
  };
  for (const name of ['drawElements', 'drawArrays']) {
    const draw = proto[name];
    proto[name] = function(...words) {
      window.__corners += name === 'drawElements' ? words[1] : words[2];
      return draw.apply(this, words);
    };
  }
"""

#: Receives the latched topics, as RViz does, without reading what is in them.
LISTENER = """
import rclpy
from rclpy.node import Node
from visualization_msgs.msg import MarkerArray
from vega_planner.nodes.planner import LATCHED
rclpy.init()
node = Node("bench_listener")
for name in ("layers", "toolpath", "toolpath_speed"):
    node.create_subscription(MarkerArray, name, lambda data: None, LATCHED, raw=True)
try:
    rclpy.spin(node)
except BaseException:
    pass
"""


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--out")
    options = parser.parse_args()
    path = setup_browser.find_browser()
    if not path:
        raise SystemExit("no Chromium found; run tools/setup_browser.py")
    figures = {}
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        plan = sample_plan.write_sample(Path(folder) / "plan")
        mesh = Path(folder) / "part.stl"
        write_stl(mesh)
        browser = playwright.chromium.launch(
            executable_path=path, headless=True, args=list(setup_browser.FLAGS)
        )
        figures |= first_pictures(browser, mesh)
        figures |= large_plan(browser, plan)
        figures |= clicks(browser, mesh)
        browser.close()
        figures |= publishing(plan)
    figures["load_average"] = os.getloadavg()[0]
    text = json.dumps(figures, indent=2)
    print(text)
    if options.out:
        Path(options.out).write_text(text + "\n")


def write_stl(path):
    import trimesh

    vertices, faces = sample_plan.dome(30.0, 60, 90, closed=True)
    trimesh.Trimesh(vertices, faces, process=False).export(path)


def first_pictures(browser, mesh):
    """From the command to a drawn part: in a browser just started, and in one in use."""
    rows = [first_picture(browser, mesh) for _ in range(1 + OPENED)]
    taken, spent = zip(*rows)
    return {
        "first_picture_new_browser_s": round(taken[0], 2),
        "first_picture_s": round(statistics.median(taken[1:]), 2),
        "first_picture_server_cpu_s": statistics.median(spent),
    }


def first_picture(browser, mesh):
    page = browser.new_page(viewport={"width": 800, "height": 600})
    began = time.perf_counter()
    code = "import sys; from vega_planner.cli import main; sys.exit(main())"
    words = ["view", str(mesh), "--port", "0", "--no-browser"]
    command = [sys.executable, "-c", code, *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as server:
        try:
            url = re.search(r"http://\S+", server.stdout.readline()).group()
            page.add_init_script(WATCH)
            page.goto(url)
            wait_for_picture(page, 3 * 10_000)
            return time.perf_counter() - began, cpu_s(server.pid)
        finally:
            page.close()
            server.terminate()


def wait_for_picture(page, corners):
    """Until a picture of at least so many corners is complete and the next one has begun."""
    page.wait_for_function(f"window.__most >= {corners}", polling=30, timeout=60_000)


def large_plan(browser, plan):
    """Load, turn and move the slider of a large plan."""
    figures = {}
    page = browser.new_page(viewport={"width": 800, "height": 600})
    page.add_init_script(WATCH)
    before = memory_mb()
    began = time.perf_counter()
    with open_viewer(str(plan), port=0) as (viewer, url):
        viewer.load()
        figures["read_plan_s"] = round(time.perf_counter() - began, 2)
        page.goto(url)
        wait_for_picture(page, 3 * 15_000 + 2 * 25_000)
        figures["load_plan_s"] = round(time.perf_counter() - began, 2)
        time.sleep(5)
        for name, layers in (("whole", None), ("half_time", 0.5)):
            if layers:
                viewer.set_time(layers * viewer.result.timeline.duration_s)
                time.sleep(2)
            fps, cpu = turning(page)
            figures[f"turning_{name}_fps"] = fps
            figures[f"turning_{name}_cpu_s_per_frame"] = cpu
        duration = viewer.result.timeline.duration_s
        answers = []
        for time_s in np.random.default_rng(1).uniform(0, duration, 200):
            start = time.perf_counter()
            viewer.set_time(float(time_s))
            answers.append(1e3 * (time.perf_counter() - start))
            time.sleep(0.01)
        figures["slider_ms_median"] = round(float(np.median(answers)), 1)
        figures["slider_ms_p95"] = round(float(np.percentile(answers, 95)), 1)
        figures["server_memory_mb"] = round(memory_mb())
        figures["memory_before_mb"] = round(before)
    page.close()
    return figures


def turning(page, seconds=6.0):
    """Pictures per second while the mouse turns the view."""
    page.mouse.move(250, 420)
    page.mouse.down()
    before = browser_cpu_s()
    start, count = time.perf_counter(), page.evaluate("window.__frames")
    step = 0
    while time.perf_counter() - start < seconds:
        step += 1
        page.mouse.move(250 + 120 * np.sin(step / 6), 420 + 20 * np.cos(step / 6))
        page.wait_for_timeout(30)
    done = page.evaluate("window.__frames") - count
    elapsed, spent = time.perf_counter() - start, browser_cpu_s() - before
    page.mouse.up()
    return round(done / elapsed, 2), round(spent / max(done, 1), 3)


def clicks(browser, mesh):
    """From a click's ray at the server to the region coloured and sent."""
    page = browser.new_page(viewport={"width": 800, "height": 600})
    with open_viewer(str(mesh), port=0) as (viewer, url):
        viewer.load()
        page.goto(url)
        page.get_by_role("button", name="Plan").wait_for()
        time.sleep(2)
        part = viewer.part
        viewer.region.picks.clear()
        eye = 1000.0 * np.array(viewer._server.initial_camera.position)
        target = np.array([0.0, 0.0, 15.0])
        face = first_hit(eye, target - eye, part.vertices, part.faces).face
        inside = []
        for _ in range(9):
            start = time.perf_counter()
            viewer.click(eye, target - eye)
            inside.append(1e3 * (time.perf_counter() - start))
        outside = []
        canvas = page.locator("canvas").first.bounding_box()
        middle = canvas["x"] + canvas["width"] / 2, canvas["y"] + canvas["height"] / 2
        for _ in range(5):
            state = viewer.region.picks.faces[face]
            start = time.perf_counter()
            page.mouse.click(*middle)
            while viewer.region.picks.faces[face] == state and time.perf_counter() - start < 5:
                time.sleep(0.002)
            outside.append(1e3 * (time.perf_counter() - start))
            time.sleep(0.5)
    page.close()
    return {
        "click_server_ms_median": round(float(np.median(inside)), 1),
        "click_to_region_ms_median": round(float(np.median(outside)), 1),
        "click_faces": len(part.faces),
    }


def publishing(plan, rounds=9):
    """Turn the layers of a large plan into messages and publish them, and the toolpaths.

    From the layers in memory to the return of `publish`; a listener in a process of its own
    receives everything, as RViz would.
    """
    os.environ |= {
        "ROS_DOMAIN_ID": str(1 + os.getpid() % 100),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    }
    import rclpy
    from rclpy.node import Node
    from visualization_msgs.msg import MarkerArray

    from vega_planner.datatypes import LayerStack
    from vega_planner.nodes.cdr import marker_array
    from vega_planner.nodes.markers import layer_markers, toolpath_markers
    from vega_planner.nodes.planner import LATCHED

    result = read_result(plan)
    stack = LayerStack(result.part, "field", 0.8, result.sheets)
    toolpaths, speeds = passes_of(result.timeline)
    makers = {
        "layers": lambda: layer_markers(stack),
        "toolpath": lambda: toolpath_markers(toolpaths),
        "toolpath_speed": lambda: toolpath_markers(toolpaths, speeds),
    }
    rclpy.init()
    node = Node("bench_viewer")
    publishers = {name: node.create_publisher(MarkerArray, name, LATCHED) for name in makers}
    listener = subprocess.Popen([sys.executable, "-c", LISTENER], stdout=subprocess.PIPE)
    while any(not publisher.get_subscription_count() for publisher in publishers.values()):
        time.sleep(0.02)
    figures = {}
    for name, make in makers.items():
        spent, cpu = [], []
        for _ in range(rounds):
            start, clock = time.perf_counter(), time.process_time()
            data = marker_array(make())
            publishers[name].publish(data)
            spent.append(1e3 * (time.perf_counter() - start))
            cpu.append(1e3 * (time.process_time() - clock))
            time.sleep(0.3)
        figures[f"publish_{name}_ms_first"] = round(spent[0], 1)
        figures[f"publish_{name}_ms_median"] = round(float(np.median(spent)), 1)
        figures[f"publish_{name}_cpu_ms_median"] = round(float(np.median(cpu)), 1)
        figures[f"publish_{name}_mb"] = round(len(data) / 1e6, 1)
    total = sum(figures[f"publish_{name}_ms_median"] for name in makers)
    figures["publish_all_ms_median"] = round(total, 1)
    listener.terminate()
    listener.wait()
    node.destroy_node()
    rclpy.shutdown()
    return figures


def passes_of(timeline):
    """The passes of a result as toolpaths, and a speed for each of their points."""
    passes, speeds = [], []
    for number in range(int(timeline.path_id.max()) + 1):
        rows = timeline.path_id == number
        points = timeline.points[rows]
        passes.append(
            Toolpath(
                patch=number,
                layer=int(timeline.layer[rows][0]),
                points=points,
                axes=timeline.axes[rows],
                width=np.full(len(points), 1.2),
                height=np.full(len(points), 0.8),
            )
        )
        speeds.append(np.full(len(points), 5.0))
    travels = tuple(Travel(points=np.zeros((0, 3)), axes=np.zeros((0, 3))) for _ in passes)
    return ToolpathSet(tuple(passes), (*travels, travels[0])), speeds


def browser_cpu_s():
    """Time all browser processes have computed: what a busy machine leaves comparable."""
    total = 0
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            text = stat.read_text()
        except OSError:
            continue
        name, rest = text[text.index("(") + 1 : text.rindex(")")], text[text.rindex(")") + 2 :]
        if name.startswith(("chrom", "headless")):
            total += sum(int(ticks) for ticks in rest.split()[11:13])
    return total / os.sysconf("SC_CLK_TCK")


def cpu_s(pid):
    """Time a process has computed so far."""
    text = Path(f"/proc/{pid}/stat").read_text()
    ticks = text[text.rindex(")") + 2 :].split()[11:13]
    return round(sum(map(int, ticks)) / os.sysconf("SC_CLK_TCK"), 2)


def memory_mb():
    """Memory this process holds now."""
    text = Path("/proc/self/status").read_text()
    return int(re.search(r"VmRSS:\s+(\d+)", text).group(1)) / 1024


if __name__ == "__main__":
    main()
