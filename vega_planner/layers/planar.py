# SPDX-License-Identifier: Apache-2.0
"""The baseline: the flat layers of an ordinary slicer."""

from __future__ import annotations

import numpy as np

from vega_planner.datatypes import Floats, Ints, Layer, LayerStack, Part
from vega_planner.errors import BadMesh, NoLayers
from vega_planner.progress import Progress, Report
from vega_planner.settings import LayerSettings


def slice_heights(part: Part, t: float) -> Floats:
    """List the heights at which an ordinary slicer cuts a part.

    Each layer is cut at the middle of its height, and the last one is made if its
    middle lies in the part, as PrusaSlicer does.

    Args:
        part: The part, standing on z = 0.
        t: Layer height [mm].

    Returns:
        Heights [mm], shape (n,).
    """
    top = float(part.vertices[:, 2].max())
    count = max(0, int(np.ceil(top / t - 0.5 - 1e-9)))
    return t / 2 + t * np.arange(count, dtype=np.float64)


def planar_layers(part: Part, settings: LayerSettings, report: Report) -> LayerStack:
    """Slice a part into flat layers.

    Args:
        part: The part.
        settings: Layer height t.
        report: Progress; may raise to stop.

    Returns:
        Flat sheets with normals up, from the bottom up. Heights at which nothing of the
        part is cut give no layer.

    Raises:
        BadMesh: If the part is no solid.
        NoLayers: If no height cuts the part.
    """
    import manifold3d

    t = settings.thickness_mm
    mesh = manifold3d.Mesh64(
        np.array(part.vertices, np.float64, order="C"),
        np.array(part.faces, np.uint64, order="C"),
    )
    solid = manifold3d.Manifold(mesh)
    if solid.status() != manifold3d.Error.NoError:
        raise BadMesh(f"part '{part.name}' is no solid: {solid.status().name}")
    layers: list[Layer] = []
    heights = slice_heights(part, t)
    for count, z in enumerate(heights):
        report(Progress("layers", count / len(heights), len(layers)))
        section = solid.slice(float(z))
        polygons = [np.asarray(ring, np.float64) for ring in section.to_polygons()]
        if not polygons:
            continue
        vertices, faces = fill_polygons(polygons, float(z))
        if len(faces) == 0:
            continue
        layers.append(
            Layer(
                index=len(layers),
                kind="planar",
                depth_mm=float(z),
                vertices=vertices,
                faces=faces,
                thickness=np.full(len(vertices), t),
            )
        )
    if not layers:
        raise NoLayers(f"no layer: the part is lower than half the layer height t = {t:g} mm")
    return LayerStack(part=part, engine="planar", thickness_mm=t, layers=tuple(layers))


def fill_polygons(polygons: list[Floats], z: float) -> tuple[Floats, Ints]:
    """Triangulate a region of a plane, holes kept.

    Args:
        polygons: Outlines, counter-clockwise, and holes, clockwise, (k, 2) each.
        z: Height of the plane [mm].

    Returns:
        Vertices (n, 3), which are the corners of the outlines, and faces (m, 3) with
        normals up.
    """
    import manifold3d

    faces = np.asarray(manifold3d.triangulate(polygons), np.int64).reshape(-1, 3)
    flat = np.concatenate(polygons)
    a, b, c = flat[faces[:, 0]], flat[faces[:, 1]], flat[faces[:, 2]]
    doubled = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    faces = faces[doubled > 0]
    vertices = np.column_stack([flat, np.full(len(flat), z)])
    return vertices, faces
