# SPDX-License-Identifier: Apache-2.0
"""Draws the six test parts: STL files, their settings, pictures and the table in README.md.

Run from the root of the repository: `.venv/bin/python parts/draw.py [FOLDER]`. The same
version of numpy and manifold3d gives the same bytes.

Five of the six are one sphere bent into shape: its upper half becomes the top of the
part, its lower half the base, so that the triangles stay even and no cut leaves slivers.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import manifold3d
import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from vega_planner.datatypes import Part
from vega_planner.part import load_part
from vega_planner.settings import load_settings

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Drawing:
    """One test part.

    Attributes:
        name: Stem of its files.
        title: What it is, in a few words.
        why: What it tries.
        brr: Restraint SPECs.
        draw: Makes vertices [mm] and faces.
    """

    name: str
    title: str
    why: str
    brr: tuple[str, ...]
    draw: Callable[[], tuple[Floats, Ints]]


def _arrays(solid: manifold3d.Manifold) -> tuple[Floats, Ints]:
    mesh = solid.to_mesh64()
    return np.array(mesh.vert_properties)[:, :3], np.array(mesh.tri_verts).astype(np.int64)


def _sphere(segments: int) -> tuple[Floats, Ints, Floats, Floats, Floats]:
    """Make a unit sphere: vertices, faces, azimuth, latitude, and both halves' plan radius.

    The plan radius runs evenly from 1 at the equator to 0 at the poles.
    """
    vertices, faces = _arrays(manifold3d.Manifold.sphere(1.0, segments))
    azimuth = np.arctan2(vertices[:, 1], vertices[:, 0])
    latitude = np.arctan2(vertices[:, 2], np.hypot(vertices[:, 0], vertices[:, 1]))
    latitude[np.abs(latitude) < 1e-9] = 0.0
    return vertices, faces, azimuth, latitude, 1 - np.abs(latitude) / (np.pi / 2)


def cross_prism() -> tuple[Floats, Ints]:
    """A cross with rounded corners and a round hole, 12 mm high."""
    plan = manifold3d.CrossSection.square((40, 16), True) + manifold3d.CrossSection.square(
        (16, 40), True
    )
    rounded = manifold3d.JoinType.Round
    plan = plan.offset(-3.0, rounded, 2.0, 128).offset(6.0, rounded, 2.0, 128)
    plan = plan.offset(-3.0, rounded, 2.0, 128)
    plan = plan - manifold3d.CrossSection.circle(5.0, 128)
    return _arrays(plan.extrude(12.0).refine_to_length(4.0))


def dome() -> tuple[Floats, Ints]:
    """A dome 40 mm across with three leaning ridges and a shoulder, on a flat base."""
    _, faces, azimuth, latitude, plan = _sphere(128)
    upper = latitude > 0
    ridges = 0.07 * np.cos(3 * azimuth + 1.2 * latitude) * np.sin(2 * latitude) ** 2
    shoulder = 0.05 * np.cos(4 * latitude) * np.cos(latitude) ** 2
    radius = 18.5 * (1 + ridges + shoulder + 0.03 * np.cos(azimuth) * np.cos(latitude))
    rim = 18.5 * (1.05 + 0.03 * np.cos(azimuth))
    along = np.where(upper, radius * np.cos(latitude), rim * plan)
    height = np.where(upper, radius * np.sin(latitude), 0.0)
    return _stacked(along, azimuth, height), faces


def clover() -> tuple[Floats, Ints]:
    """A low cushion with five lobes and a dimple on top, on a flat base."""
    _, faces, azimuth, latitude, plan = _sphere(128)
    upper = latitude > 0
    lobes = 1 + 0.13 * np.cos(5 * azimuth) * np.minimum(1.0, 2.0 * plan) ** 2
    swell = np.cos(np.maximum(latitude, 0.0)) ** 0.8
    along = 18.0 * lobes * np.where(upper, swell, plan)
    top = 13.0 * np.maximum(np.sin(latitude), 0.0) ** 0.9
    dimple = 3.0 * np.exp(-((along / 7.0) ** 2))
    waves = 0.5 * np.cos(5 * azimuth) * np.sin(2 * np.maximum(latitude, 0.0)) ** 2
    height = np.where(upper, top - dimple + waves, 0.0)
    return _stacked(along, azimuth, height), faces


def saddle_cap() -> tuple[Floats, Ints]:
    """A domed cap on a saddle-shaped base."""
    _, faces, azimuth, latitude, plan = _sphere(128)
    upper = latitude > 0
    along = 20.0 * np.where(upper, np.cos(latitude), plan)
    saddle = 3.5 * (1 + (along / 20.0) ** 2 * np.cos(2 * azimuth))
    height = saddle + np.where(upper, 12.0 * np.sin(latitude), 0.0)
    return _stacked(along, azimuth, height), faces


def egg() -> tuple[Floats, Ints]:
    """An egg on its side, 40 mm long: closed, nowhere flat."""
    vertices, faces, *_ = _sphere(120)
    x, y, z = vertices.T
    girth = 15.0 * (1 - 0.16 * x - 0.05 * x**2)
    return np.stack([20.0 * x, girth * y, girth * z], axis=1), faces


def peanut() -> tuple[Floats, Ints]:
    """A peanut on its side, 42 mm long, with a bend: closed and waisted."""
    vertices, faces, *_ = _sphere(128)
    x, y, z = vertices.T
    girth = 12.5 * (0.62 + 0.95 * x**2 + 0.04 * x)
    bend = 3.0 * x**2
    return np.stack([21.0 * x, girth * y + bend, girth * 1.05 * z], axis=1), faces


def _stacked(along: Floats, azimuth: Floats, height: Floats) -> Floats:
    return np.stack([along * np.cos(azimuth), along * np.sin(azimuth), height], axis=1)


DRAWINGS = (
    Drawing(
        "part0_cross_prism",
        "cross-shaped prism with a hole",
        "free only on top, it gives the planar layers of an ordinary slicer",
        ("not:normal:0,0,1:20",),
        cross_prism,
    ),
    Drawing(
        "part1_dome",
        "dome with leaning ridges and a shoulder",
        "inclined and organic features over a flat base",
        ("down",),
        dome,
    ),
    Drawing(
        "part2_clover",
        "five-lobed cushion with a dimple",
        "wavy walls and a hollow on top over a flat base",
        ("down",),
        clover,
    ),
    Drawing(
        "part3_saddle_cap",
        "domed cap on a saddle",
        "a curved restraint region; it needs a conformal substrate",
        ("normal:0,0,-1:30",),
        saddle_cap,
    ),
    Drawing(
        "part4_egg",
        "egg on its side",
        "closed shells all round, split by printability",
        ("none",),
        egg,
    ),
    Drawing(
        "part5_peanut",
        "bent peanut on its side",
        "closed shells that fall apart into two at the waist",
        ("none",),
        peanut,
    ),
)


def write_stl(path: Path, name: str, vertices: Floats, faces: Ints) -> None:
    """Write a binary STL."""
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    rows = np.zeros(len(faces), record)
    corners = vertices[faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    rows["normal"] = cross / np.linalg.norm(cross, axis=1, keepdims=True)
    rows["corners"] = corners
    header = f"{name} [mm]".encode().ljust(80)
    path.write_bytes(header + len(faces).to_bytes(4, "little") + rows.tobytes())


def write_settings(path: Path, drawing: Drawing) -> None:
    """Write the settings file of a part."""
    specs = ", ".join(f'"{spec}"' for spec in drawing.brr)
    path.write_text(
        "# SPDX-License-Identifier: Apache-2.0\n"
        f"# {drawing.title[0].upper()}{drawing.title[1:]}: {drawing.why}.\n"
        f"part:\n  brr: [{specs}]\n  unit: mm\n",
        encoding="utf-8",
    )


def picture(path: Path, part: Part) -> None:
    """Draw a part from above and from below, the restraint region in orange."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    figure = pyplot.figure(figsize=(5.0, 2.4), dpi=100)
    middle = part.bounds.mean(0)
    for index, elevation in enumerate((28, -35)):
        axes = figure.add_subplot(1, 2, index + 1, projection="3d")
        light = np.array([0.35, -0.5, 0.79 * np.sign(elevation)])
        shade = 0.35 + 0.65 * np.clip(part.face_normals @ light, 0, 1)
        colour = np.where(
            part.restrained[:, None],
            (0.95, 0.55, 0.15),
            (0.55, 0.68, 0.82),
        )
        axes.add_collection3d(
            Poly3DCollection(
                part.vertices[part.faces],
                facecolors=colour * shade[:, None],
                linewidths=0,
                antialiaseds=False,
            )
        )
        for setter, centre in zip((axes.set_xlim, axes.set_ylim, axes.set_zlim), middle):
            setter(centre - 13, centre + 13)
        axes.set_box_aspect((1, 1, 1))
        axes.view_init(elev=elevation, azim=-60)
        axes.set_axis_off()
    figure.subplots_adjust(0, 0, 1, 1, 0, 0)
    figure.savefig(path, metadata={"Software": None})
    pyplot.close(figure)


def table(parts: list[tuple[Drawing, Part]]) -> str:
    """Write the README of the folder."""
    lines = [
        "# Test parts",
        "",
        "Six parts after the paper's six: #0 to #2 stand on flat bases, #3 to #5 on curved ones,",
        "#4 and #5 are closed and nowhere flat. `parts/draw.py` draws them and writes everything",
        "in this folder. The restraint region (BRR) is orange; each part is seen from above and",
        "from below. Plan one with its settings:",
        "",
        "    .venv/bin/vega plan parts/part1_dome.stl --settings parts/part1_dome.yaml -o out/d",
        "",
        "| part | | size [mm] | volume [mm³] | triangles | BRR | what it tries |",
        "| --- | --- | --- | --- | --- | --- | --- |",
    ]
    for drawing, part in parts:
        size = " × ".join(f"{side:.1f}" for side in np.ptp(part.bounds, axis=0))
        lines.append(
            f"| `{drawing.name}` | ![{drawing.title}]({drawing.name}.png) | {size} "
            f"| {part.volume:.0f} | {len(part.faces)} "
            f"| `{' '.join(drawing.brr)}` | {drawing.title}: {drawing.why} |"
        )
    return "\n".join(lines) + "\n"


def main(folder: Path) -> None:
    """Draw every part into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    done = []
    for drawing in DRAWINGS:
        stem = folder / drawing.name
        vertices, faces = drawing.draw()
        write_stl(stem.with_suffix(".stl"), drawing.name, vertices, faces)
        write_settings(stem.with_suffix(".yaml"), drawing)
        settings = load_settings(stem.with_suffix(".yaml"))
        part = load_part(stem.with_suffix(".stl"), settings.part)
        picture(stem.with_suffix(".png"), part)
        done.append((drawing, part))
        print(f"{drawing.name}: {len(part.faces)} triangles, {part.volume:.0f} mm³")
    (folder / "README.md").write_text(table(done), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parent)
