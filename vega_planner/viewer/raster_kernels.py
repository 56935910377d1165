# SPDX-License-Identifier: Apache-2.0
# mypy: disable-error-code="no-untyped-def"
"""Kernels that draw triangles and lines into an image with a depth buffer."""

from __future__ import annotations

import numpy as np

from vega_planner.compiled import kernel

#: In a box of more pixels than this across, only what lies between the edges is looked at.
_BROAD = 8

#: Share of the light that reaches every surface, and that of the lamp.
_AMBIENT, _LAMP = 0.35, 0.65


@kernel
def draw_triangles(image, depth, points, faces, colours, light):
    """Draw shaded triangles, colours interpolated between the corners.

    Both sides are lit, since layers are sheets.

    Args:
        image: Colours to paint on, shape (h, w, 3) float32, 0 to 255.
        depth: Depth buffer, larger is nearer, shape (h, w) float32.
        points: Pixel coordinates and depth of the vertices, shape (n, 3), y down.
        faces: Vertex indices, shape (m, 3).
        colours: Colours of the vertices, shape (n, 3) float32.
        light: Direction to the lamp in picture coordinates, shape (3,).
    """
    height, width = depth.shape
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay, az = points[a, 0], points[a, 1], points[a, 2]
        ux, uy, uz = points[b, 0] - ax, points[b, 1] - ay, points[b, 2] - az
        vx, vy, vz = points[c, 0] - ax, points[c, 1] - ay, points[c, 2] - az
        twice = ux * vy - uy * vx
        if twice == 0.0:
            continue
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, twice
        length = np.sqrt(nx * nx + ny * ny + nz * nz)
        if nz < 0:
            length = -length
        shade = (nx * light[0] + ny * light[1] + nz * light[2]) / length
        shade = _AMBIENT + _LAMP * max(shade, 0.0)
        x0 = max(int(np.ceil(min(ax, ax + ux, ax + vx) - 0.5)), 0)
        x1 = min(int(np.floor(max(ax, ax + ux, ax + vx) - 0.5)), width - 1)
        y0 = max(int(np.ceil(min(ay, ay + uy, ay + vy) - 0.5)), 0)
        y1 = min(int(np.floor(max(ay, ay + uy, ay + vy) - 0.5)), height - 1)
        inverse = 1.0 / twice
        for y in range(y0, y1 + 1):
            py = y + 0.5 - ay
            first, last = x0, x1
            if x1 - x0 > _BROAD:
                # a needle fills little of its box: between its edges only, and a pixel more
                low, high = np.inf, -np.inf
                for ex, fx, ey, fy in ((0.0, ux, 0.0, uy), (0.0, vx, 0.0, vy), (ux, vx, uy, vy)):
                    if min(ey, fy) <= py <= max(ey, fy):
                        at = ex + (fx - ex) * ((py - ey) / (fy - ey)) if ey != fy else ex
                        end = at if ey != fy else fx
                        low, high = min(low, at, end), max(high, at, end)
                if low > high:
                    continue
                first = max(x0, int(np.floor(ax + low - 0.5)) - 1)
                last = min(x1, int(np.ceil(ax + high - 0.5)) + 1)
            for x in range(first, last + 1):
                px = x + 0.5 - ax
                s = (px * vy - py * vx) * inverse
                t = (ux * py - uy * px) * inverse
                if s < 0 or t < 0 or s + t > 1:
                    continue
                z = az + s * uz + t * vz
                if z <= depth[y, x]:
                    continue
                depth[y, x] = z
                for k in range(3):
                    image[y, x, k] = shade * (
                        (1 - s - t) * colours[a, k] + s * colours[b, k] + t * colours[c, k]
                    )


@kernel
def draw_lines(image, depth, points, joined, colours, radius, lift):
    """Draw lines between consecutive points.

    Args:
        image: Colours to paint on, shape (h, w, 3) float32.
        depth: Depth buffer, larger is nearer, shape (h, w) float32.
        points: Pixel coordinates and depth, shape (n, 3).
        joined: True where a line joins point i and i + 1, shape (n - 1,).
        colours: Colours of the points, shape (n, 3) float32.
        radius: Half the line's width in pixels.
        lift: Depth by which lines are moved towards the eye, so that they win over
            the surface they lie on.
    """
    height, width = depth.shape
    for i in range(len(points) - 1):
        if not joined[i]:
            continue
        dx, dy = points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1]
        dz = points[i + 1, 2] - points[i, 2]
        steps = int(max(abs(dx), abs(dy)) / max(0.7 * radius, 1.0)) + 1
        for s in range(steps):
            t = s / steps
            cx, cy = points[i, 0] + t * dx, points[i, 1] + t * dy
            z = points[i, 2] + t * dz + lift
            for y in range(int(np.floor(cy - radius + 0.5)), int(np.ceil(cy + radius - 0.5))):
                for x in range(int(np.floor(cx - radius + 0.5)), int(np.ceil(cx + radius - 0.5))):
                    if 0 <= x < width and 0 <= y < height and z > depth[y, x]:
                        depth[y, x] = z
                        for k in range(3):
                            image[y, x, k] = colours[i, k]


@kernel
def average(image, finer):
    """Average blocks of finer x finer pixels.

    Args:
        image: Colours, shape (h finer, w finer, 3) float32, 0 to 255.
        finer: Edge of the blocks.

    Returns:
        Picture, shape (h, w, 3) uint8.
    """
    height, width = image.shape[0] // finer, image.shape[1] // finer
    result = np.empty((height, width, 3), np.uint8)
    for y in range(height):
        for x in range(width):
            for k in range(3):
                total = 0.0
                for i in range(finer):
                    for j in range(finer):
                        total += image[y * finer + i, x * finer + j, k]
                result[y, x, k] = np.uint8(min(max(total / finer**2 + 0.5, 0.0), 255.0))
    return result
