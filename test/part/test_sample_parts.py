# SPDX-License-Identifier: Apache-2.0
"""The six shipped parts: sound, as drawn, and what their settings say of them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from vega_planner.part import load_part
from vega_planner.settings import load_settings

PARTS = Path(__file__).resolve().parents[2] / "parts"
NAMES = (
    "part0_cross_prism",
    "part1_dome",
    "part2_clover",
    "part3_saddle_cap",
    "part4_egg",
    "part5_peanut",
)


@pytest.fixture(scope="module")
def parts():
    return {
        name: load_part(PARTS / f"{name}.stl", load_settings(PARTS / f"{name}.yaml").part)
        for name in NAMES
    }


@pytest.mark.parametrize("name", NAMES)
def test_a_shipped_part_is_clean_and_of_the_right_size(parts, name):
    part = parts[name]
    assert part.warnings == ()
    assert 2000 <= len(part.faces) <= 20000
    assert 38 <= np.ptp(part.vertices, axis=0).max() <= 43
    corners = part.vertices[part.faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(1)
    assert (2 * part.face_areas / longest).min() > 1e-3  # no slivers
    assert (PARTS / f"{name}.png").stat().st_size > 1000


def test_flat_bases_are_restrained_exactly_there(parts):
    for name in ("part1_dome", "part2_clover"):
        part = parts[name]
        flat = part.vertices[part.faces][:, :, 2].max(1) < 1e-6
        assert (part.restrained == flat).all() and flat.any()


def test_the_prism_is_free_on_its_level_top_only(parts):
    part = parts["part0_cross_prism"]
    top = part.vertices[part.faces][:, :, 2].min(1) > 12 - 1e-5
    assert (part.restrained == ~top).all()


def test_the_cap_is_restrained_on_its_whole_curved_base(parts):
    part = parts["part3_saddle_cap"]
    x, y, z = part.vertices[np.unique(part.faces[part.restrained])].T
    offset = z - 3.5 * (1 + (x**2 - y**2) / 400.0)
    assert np.abs(offset - offset.mean()).max() < 1e-4
    assert np.hypot(x, y).max() == pytest.approx(20, abs=1e-3)
    assert np.ptp(part.face_normals[part.restrained], axis=0).max() > 0.3  # it is curved


def test_closed_parts_are_enveloped_in_full(parts):
    for name in ("part4_egg", "part5_peanut"):
        assert not parts[name].restrained.any()


def test_the_peanut_is_waisted():
    part = load_part(PARTS / "part5_peanut.stl")
    x, _, z = part.vertices.T
    waist = np.ptp(z[np.abs(x - x.mean()) < 1])
    assert waist < 0.85 * np.ptp(z)


def test_drawing_again_gives_the_same_bytes(tmp_path):
    subprocess.run([sys.executable, PARTS / "draw.py", tmp_path], check=True, capture_output=True)
    for name in NAMES:
        for ending in (".stl", ".yaml"):
            shipped = (PARTS / name).with_suffix(ending)
            assert (tmp_path / name).with_suffix(ending).read_bytes() == shipped.read_bytes()
    assert (tmp_path / "README.md").read_text() == (PARTS / "README.md").read_text()
