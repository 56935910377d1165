# SPDX-License-Identifier: Apache-2.0
"""The screen after a plan says what the plan says, also where it is bad news."""

import re
from dataclasses import replace

import trimesh

from vega_planner import Settings, plan
from vega_planner.cli.terminal import summary_lines
from vega_planner.viewer.plan_page import plan_page


def test_colliding_waypoints_are_told_on_the_screen_and_in_the_page():
    mesh = trimesh.creation.box((8, 8, 3))
    sound = plan(
        (mesh.vertices, mesh.faces, "box"), Settings().updated({"part": {"brr": ["down"]}})
    )
    for count in (0, 4711):
        told = replace(sound, collisions={**sound.collisions, "colliding_waypoints": count})
        lines = summary_lines(told.summary, "out")
        assert [line for line in lines if f" {count} colliding waypoints" in line]
        row = rf"<td[^>]*>Colliding waypoints</td><td[^>]*>{count}</td>"
        assert re.search(row, plan_page(told).decode())
