# SPDX-License-Identifier: Apache-2.0
"""Patches with known geometry, and a cell that is only a plate and a tool."""

from types import SimpleNamespace

import numpy as np
import pytest

from vega_planner.datatypes import Layer, LayerStack, Part, Patch


def _dome(radius, degrees, triangles):
    """Cap of a sphere up to a polar angle, in rings of nearly equal triangles."""
    theta = np.radians(degrees)
    area = 2 * np.pi * radius**2 * (1 - np.cos(theta))
    edge = np.sqrt(4 / np.sqrt(3) * area / triangles)
    rings = max(2, round(radius * theta / edge))
    vertices, faces = [[0.0, 0.0, radius]], []
    before, angles_before = [0], np.zeros(1)
    for k in range(1, rings + 1):
        polar = theta * k / rings
        count = max(6, round(2 * np.pi * radius * np.sin(polar) / edge))
        angles = 2 * np.pi * (np.arange(count) + 0.5 * (k % 2)) / count
        ring = list(range(len(vertices), len(vertices) + count))
        for a in angles:
            vertices.append(
                [
                    radius * np.sin(polar) * np.cos(a),
                    radius * np.sin(polar) * np.sin(a),
                    radius * np.cos(polar),
                ]
            )
        if len(before) == 1:
            faces += [[0, ring[i], ring[(i + 1) % count]] for i in range(count)]
        else:
            i = j = 0
            p = len(before)
            while i < p or j < count:
                turn_i = angles_before[(i + 1) % p] + 2 * np.pi * ((i + 1) // p)
                turn_j = angles[(j + 1) % count] + 2 * np.pi * ((j + 1) // count)
                if j >= count or (i < p and turn_i < turn_j):
                    faces.append([before[i % p], ring[j % count], before[(i + 1) % p]])
                    i += 1
                else:
                    faces.append([before[i % p], ring[j % count], ring[(j + 1) % count]])
                    j += 1
        before, angles_before = ring, angles
    return np.array(vertices), np.array(faces)


def _sheet(height, size=(40.0, 30.0), triangles=20000):
    """Graph of a function over a rectangle."""
    edge = np.sqrt(2 * size[0] * size[1] / triangles)
    nx, ny = int(size[0] / edge), int(size[1] / edge)
    x, y = np.meshgrid(
        np.linspace(-size[0] / 2, size[0] / 2, nx + 1),
        np.linspace(-size[1] / 2, size[1] / 2, ny + 1),
        indexing="ij",
    )
    first = np.arange(nx * (ny + 1)).reshape(nx, ny + 1)[:, :-1].ravel()
    below = np.column_stack([first, first + ny + 1, first + ny + 2])
    above = np.column_stack([first, first + ny + 2, first + 1])
    vertices = np.column_stack([x.ravel(), y.ravel(), height(x, y).ravel()])
    return vertices, np.concatenate([below, above])


def _patch(vertices, faces, layer=0, thickness=0.8, max_tilt=75.0):
    upright = np.tile([0.0, 0.0, 1.0], (len(vertices), 1))
    depth = np.full(len(vertices), thickness)
    axes = np.array(Patch(layer, vertices, faces, depth, upright).vertex_normals)
    low = np.cos(np.radians(max_tilt))
    flat = np.linalg.norm(axes[:, :2], axis=1)
    steep = axes[:, 2] < low
    axes[steep, :2] *= (np.sqrt(1 - low**2) / flat[steep])[:, None]
    axes[steep, 2] = low
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    return Patch(layer, vertices, faces, depth, axes)


def _stack(patches, engine="field"):
    layers = tuple(
        Layer(n, "envelope", 0.4 + 0.8 * n, p.vertices, p.faces, p.thickness)
        for n, p in enumerate(sorted(patches, key=lambda p: p.layer))
    )
    first = patches[-1]
    part = Part("part", first.vertices, first.faces, np.zeros(len(first.faces), np.bool_))
    return LayerStack(part, engine, 0.8, layers)


def _cell(plate_z_mm=0.0):
    tool = SimpleNamespace(
        distance=np.array([0.0, 20.0, 30.0, 45.0, 120.0]),
        radius=np.array([0.65, 2.2, 4.5, 12.0, 12.0]),
    )
    return SimpleNamespace(
        tool=tool, placement=SimpleNamespace(plate_z_mm=plate_z_mm), substrate=None
    )


@pytest.fixture
def make():
    """Builders of patches, stacks and cells."""

    def dome(radius=30.0, degrees=60.0, triangles=20000, layer=0, z=0.0, max_tilt=75.0):
        vertices, faces = _dome(radius, degrees, triangles)
        vertices[:, 2] += z - vertices[:, 2].min()
        return _patch(vertices, faces, layer, max_tilt=max_tilt)

    def wavy(amplitude=2.0, wave=20.0, triangles=20000):
        k = 2 * np.pi / wave

        def height(x, y):
            return 10 + amplitude * np.sin(k * x) * np.cos(k * y)

        return _patch(*_sheet(height, triangles=triangles))

    def wavy_disc(radius=22.0, amplitude=2.0, wave=22.0, triangles=20000):
        vertices, faces = _dome(radius, 90.0, triangles)
        across = np.hypot(vertices[:, 0], vertices[:, 1])
        flat = radius * np.arctan2(across, vertices[:, 2]) / (0.5 * np.pi)
        x, y = (vertices[:, :2] * (flat / np.maximum(across, 1e-9))[:, None]).T
        k = 2 * np.pi / wave
        height = 10 + amplitude * np.sin(k * x) * np.cos(k * y)
        return _patch(np.column_stack([x, y, height]), faces)

    def nest(radius=20.0, count=6, triangles=3000):
        """Nested half spheres, the inner one first."""
        return tuple(
            dome(radius - 0.4 - 0.8 * n, 90.0, triangles, n) for n in reversed(range(count))
        )

    def flat(polygon_points, layer=0, triangles=None):
        import manifold3d

        rings = [np.asarray(ring, dtype=float) for ring in polygon_points]
        faces = np.asarray(manifold3d.triangulate(rings), dtype=np.int64)
        points = np.concatenate(rings)
        vertices = np.column_stack([points, np.full(len(points), 0.4 + 0.8 * layer)])
        return _patch(vertices, faces, layer)

    return SimpleNamespace(
        dome=dome,
        wavy=wavy,
        wavy_disc=wavy_disc,
        nest=nest,
        flat=flat,
        stack=_stack,
        cell=_cell,
        mesh=_dome,
    )
