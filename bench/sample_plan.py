# SPDX-License-Identifier: Apache-2.0
"""A result folder of any size without planning: nested domes with rings on them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from vega_planner.results.ply import mesh_ply
from vega_planner.results.tables import SI_DECIMALS, TOOLPATH_COLUMNS, format_rows

JOINTS = ("x_axis", "y_axis", "z_axis", "a_axis", "b_axis")
#: The middle of the plate of vega5 in its base.
PLATE_Z_M = 0.1


def write_sample(
    folder: Path,
    *,
    layers: int = 20,
    faces_per_layer: int = 10_000,
    points_per_layer: int = 10_000,
    radius_mm: float = 30.0,
    unprintable: bool = True,
) -> Path:
    """Write the folder of a dome of so many layers, each of a pass, printed inside out.

    Args:
        folder: Where to.
        layers: Number of envelope layers.
        faces_per_layer: Triangles of each, about.
        points_per_layer: Waypoints of each.
        radius_mm: Radius of the part.
        unprintable: Mark the steepest faces of the first layer as out of reach.
    """
    (folder / "layers").mkdir(parents=True, exist_ok=True)
    thickness = 0.8 * radius_mm / 30.0 if layers <= 20 else radius_mm / (1.5 * layers)
    turns = max(int(np.sqrt(faces_per_layer)), 6)
    rings = max(faces_per_layer // (2 * turns), 3)
    vertices, faces = dome(radius_mm, rings, turns, closed=True)
    (folder / "part.ply").write_bytes(mesh_ply(vertices, faces))
    base = faces[(vertices[faces][:, :, 2] < 1e-9).all(1)]
    used, flat = np.unique(base, return_inverse=True)
    (folder / "restraint.ply").write_bytes(mesh_ply(vertices[used], flat.reshape(-1, 3)))
    for index in range(layers):
        v, f = dome(radius_mm - (index + 0.5) * thickness, rings, turns)
        steep = (v[f].mean(1)[:, 2] < 0.15 * radius_mm) & unprintable & (index == 0)
        data = mesh_ply(v, f, {"thickness": np.full(len(v), thickness)}, {"reason": 2 * steep})
        (folder / "layers" / f"layer_{index:03d}.ply").write_bytes(data)
    rows = toolpath(layers, points_per_layer, radius_mm, thickness)
    header = ",".join(TOOLPATH_COLUMNS) + "\n"
    table = format_rows(rows, list(TOOLPATH_COLUMNS.values()))
    (folder / "toolpath.csv").write_bytes(header.encode() + table)
    duration = write_trajectory(folder, rows)
    write_summary(folder, layers, thickness, len(base), duration, unprintable)
    return folder


def dome(radius, rings, turns, closed=False):
    """A half ball standing on z = 0: vertices (n, 3), faces (m, 3)."""
    tilt = np.linspace(np.pi / 2, 0, rings, endpoint=False)
    turn = np.arange(turns) * 2 * np.pi / turns
    ring = np.stack(
        [np.outer(np.sin(tilt), np.cos(turn)), np.outer(np.sin(tilt), np.sin(turn)),
         np.outer(np.cos(tilt), np.ones(turns))], axis=2,
    )  # fmt: skip
    ring[0, :, 2] = 0.0
    vertices = np.vstack([radius * ring.reshape(-1, 3), [[0, 0, radius], [0, 0, 0]]])
    low = (np.arange(rings - 1)[:, None] * turns + np.arange(turns)).ravel()
    after = (np.arange(rings - 1)[:, None] * turns + (np.arange(turns) + 1) % turns).ravel()
    k, n = np.arange(turns), (np.arange(turns) + 1) % turns
    top = rings * turns
    blocks = [
        np.column_stack([low, after, after + turns]),
        np.column_stack([low, after + turns, low + turns]),
        np.column_stack([k + top - turns, n + top - turns, np.full(turns, top)]),
    ]
    if closed:
        blocks.append(np.column_stack([n, k, np.full(turns, top + 1)]))
        return vertices, np.concatenate(blocks)
    return vertices[:-1], np.concatenate(blocks)


def toolpath(layers, count, radius, thickness):
    """Rows of toolpath.csv: a spiral up each dome, the innermost first, travel between."""
    blocks = []
    for order, index in enumerate(reversed(range(layers))):
        share = np.linspace(0, 1, count)
        tilt = np.arccos(np.clip(share * 0.985, 0, 1))
        turn = 2 * np.pi * 22 * share
        axis = np.column_stack(
            [np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)]
        )
        block = np.zeros((count, len(TOOLPATH_COLUMNS)))
        block[:, 0], block[:, 1], block[:, 2] = order, index, order
        block[:, 3:6] = (radius - (index + 0.5) * thickness) * axis
        # The nozzle leans half as far as the surface.
        lean = axis + np.array([0, 0, 1.0])
        block[:, 6:9] = lean / np.linalg.norm(lean, axis=1, keepdims=True)
        block[:, 9], block[:, 10], block[:, 11] = 1.2, thickness, 1
        block[0, 11] = 0
        blocks.append(block)
        move = np.repeat(block[-1:], 2, axis=0)
        move[:, 0], move[:, 11] = -1, 0
        move[:, 5] = radius + 5
        if index > 0:
            move[1, 3:5] = (radius - (index - 0.5) * thickness), 0
            blocks.append(move)
    return np.concatenate(blocks)


def write_trajectory(folder, rows):
    """Write trajectory.csv: the tip at 5 mm/s on passes, the joints of a 3P+2R gantry."""
    from vega_planner.robot.robot import load_robot

    length = np.linalg.norm(np.diff(rows[:, 3:6], axis=0), axis=1)
    speed = np.where(rows[1:, 0] >= 0, 5.0, 40.0)
    times = np.concatenate([[0.0], np.cumsum(np.maximum(length / speed, 1e-4))])
    robot = load_robot("vega5")
    points = rows[:, 3:6] / 1000 + robot.chain.T_base_plate[:3, 3]
    q = robot.solve(points, rows[:, 6:9]).candidates[:, 0]
    table = np.column_stack([times, q, rows[:, 11], rows[:, 0]])
    names = ["t_s", *robot.joint_names, "extrude", "path_id"]
    text = format_rows(table, [SI_DECIMALS] * (1 + q.shape[1]) + [0, 0])
    (folder / "trajectory.csv").write_bytes((",".join(names) + "\n").encode() + text)
    return float(times[-1])


def write_summary(folder, layers, thickness, faces, duration, unprintable):
    """Write summary.json."""
    from vega_planner.robot.robot import load_robot

    reasons = []
    if unprintable:
        reasons = [
            {"code": "wrist_limit", "layer": 0, "area_mm2": 812.0, "where_mm": [29.0, 0, 2.0],
             "remedy": "turn the part by 20° or allow 12° more tilt"}
        ]  # fmt: skip
    summary = {
        "mesh": "dome",
        "engine": "field",
        "layer_thickness_mm": thickness,
        "bead_width_mm": 1.2,
        "layers": layers,
        "cores": [],
        "volume_mm3": 56549.0,
        "brr": {"spec": ["down"], "faces": faces, "area_mm2": 2827.0},
        "robot": "vega5",
        "T_base_part": load_robot("vega5").chain.T_base_plate.tolist(),
        "printability": {
            "status": "conditionally" if unprintable else "fully",
            "reachable_ratio": 0.99,
            "accessible_ratio": 1.0,
            "collision_free_ratio": 1.0,
            "split_layers": 0,
            "reasons": reasons,
        },
        "path_length_mm": 52000.0,
        "travel_length_mm": 900.0,
        "print_time_s": duration,
        "material_mm3": 49000.0,
        "coverage": {"under_ratio": 0.01, "over_ratio": 0.004},
        "warnings": [],
        "total_s": 0.0,
    }
    (folder / "summary.json").write_text(json.dumps(summary, indent=2))
