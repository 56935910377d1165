# SPDX-License-Identifier: Apache-2.0
"""The paper's buffering-erosion process, literally, with booleans on solids.

    C = (∂A_i \\ ∂A_i*) ⊕ B_r,    D = A_i \\ C,    ∂A_(i+1) = ∂D \\ ∂A*_(i+1)

with r = t/2 once and t afterwards, until the volume is gone. The buffer C is the union,
over the free triangles, of the hull of a triangle swept by a ball. It is slow (minutes
beyond a thousand triangles, and worse where free faces are concave) and serves as the
oracle of the default engine.
"""

from __future__ import annotations

from collections.abc import Iterator

import manifold3d
import numpy as np

from vega_planner.datatypes import Bools, Floats, Ints, Layer, LayerStack, Part, face_cross
from vega_planner.layers.transfer import restraint_disagreement, transfer_restraint
from vega_planner.part.morton import morton_order
from vega_planner.part.solid import checked, from_solid, to_tagged_solid
from vega_planner.part.topology import compact
from vega_planner.progress import Progress, Report, silent
from vega_planner.settings import LayerSettings

#: Facets round the ball. The facets lie inside the ball, so that concave regions erode
#: up to `facet_error_mm` too little; flat faces are exact at any number.
SEGMENTS = 32
#: Simplification of each eroded solid [mm]; without it booleans pile up slivers.
SIMPLIFY_MM = 1e-3
#: A piece smaller than this [mm³] is left over by rounding, not by the process.
SPECK_MM3 = 1e-3
#: Hulls united between two reports; a few hundredths of a second.
BATCH = 16
#: Share of the restraint region's area on which transfer and provenance may differ
#: without a word; the rim's triangles have their centroids off by a fraction of r.
AGREEMENT_RATIO = 0.02


def facet_error_mm(radius_mm: float, segments: int = SEGMENTS) -> float:
    """Bound how much too little a faceted ball erodes at concave places [mm].

    The ball's octahedral grid leaves its worst facet 1.65 times as deep as a facet of a
    regular polygon with as many segments.
    """
    return 1.65 * radius_mm * (1.0 - float(np.cos(np.pi / segments)))


def minkowski_layers(
    part: Part,
    settings: LayerSettings,
    edge_angle_deg: float = 30.0,
    report: Report = silent,
    *,
    segments: int = SEGMENTS,
) -> LayerStack:
    """Generate envelope layers by the paper's iteration.

    The restraint region of each eroded solid is known exactly, from the faces its
    triangles stem from. The paper's own transfer (by median normal) is run beside it,
    and the stack warns where the two disagree.

    Args:
        part: The part with its restraint region.
        settings: For the layer thickness t.
        edge_angle_deg: The paper's θ_edge [deg], for the transfer.
        report: Receives progress; may raise `Cancelled`.
        segments: Facets round the ball, a multiple of 4.

    Returns:
        The stack, its cores empty; no layer at all where the part is thinner than t.

    Raises:
        BadMesh: If manifold3d fails on a solid.

    Source:
        The paper, section II, steps 1 to 4 and the restrained process.
    """
    thickness = settings.thickness_mm
    vertices, faces, restrained = part.vertices, part.faces, part.restrained
    ball = unit_ball(segments)
    layers: list[Layer] = []
    warnings: list[str] = []
    progress = 0.0
    while True:
        tagged = to_tagged_solid(vertices, faces, restrained)
        radius = thickness if layers else thickness / 2
        buffers: list[manifold3d.Manifold] = []
        for piece in _buffer_pieces(vertices, faces, ~restrained, radius, ball):
            buffers.append(piece)
            report(Progress("layers", progress, len(layers)))
        while len(buffers) > 1:
            buffers = [_united(buffers[i : i + 2]) for i in range(0, len(buffers), 2)]
            report(Progress("layers", progress, len(layers)))
        eroded = checked(tagged.solid - buffers[0], f"eroding layer {len(layers)}")
        if eroded.volume() < SPECK_MM3:
            break
        before = (vertices, faces, restrained)
        vertices, faces, restrained = _tidied(*from_solid(eroded, tagged.restrained_id))
        if not len(faces):
            break
        layers.append(_layer(len(layers), thickness, vertices, faces[~restrained]))
        if before[2].any():
            handed_on = transfer_restraint(*before, vertices, faces, edge_angle_deg)
            share = restraint_disagreement(vertices, faces, restrained, handed_on)
            if share > AGREEMENT_RATIO:
                warnings.append(
                    f"layer {len(layers) - 1}: the paper's transfer of the restraint region "
                    f"disagrees with the exact one on {share:.0%} of its area; the exact one "
                    "is used"
                )
        progress = max(progress, 1.0 - eroded.volume() / part.volume)
        report(Progress("layers", progress, len(layers)))
    report(Progress("layers", 1.0, len(layers)))
    return LayerStack(part, "minkowski", thickness, tuple(layers), warnings=tuple(warnings))


def unit_ball(segments: int) -> Floats:
    """Points of the unit sphere on manifold3d's octahedral grid, shape (n, 3)."""
    mesh = manifold3d.Manifold.sphere(1.0, segments).to_mesh64()
    return np.array(mesh.vert_properties)[:, :3]


def swept_triangle(corners: Floats, normal: Floats, ball: Floats) -> manifold3d.Manifold:
    """Sweep a triangle by a ball.

    Args:
        corners: The triangle [mm], shape (3, 3).
        normal: Its unit normal, shape (3,).
        ball: Points of the ball's surface [mm], shape (n, 3).

    Returns:
        The hull of the ball at the three corners, with the exact offsets of the
        triangle to both sides, so that its flat sides are at the ball's radius.
    """
    reach = np.linalg.norm(ball[0]) * normal
    points = np.vstack([*(corner + ball for corner in corners), corners + reach, corners - reach])
    return manifold3d.Manifold.hull_points(points)


def _buffer_pieces(
    vertices: Floats, faces: Ints, free: Bools, radius: float, ball: Floats
) -> Iterator[manifold3d.Manifold]:
    """Yield unions of a few swept triangles each, neighbours in space together."""
    cross = face_cross(vertices, faces[free])
    lengths = np.linalg.norm(cross, axis=1)
    sound = lengths > 1e-12
    corners = vertices[faces[free][sound]]
    normals = cross[sound] / lengths[sound, None]
    order = morton_order(corners.mean(1))
    for start in range(0, len(order), BATCH):
        hulls = [
            swept_triangle(corners[i], normals[i], ball * radius)
            for i in order[start : start + BATCH]
        ]
        yield _united(hulls)


def _united(solids: list[manifold3d.Manifold]) -> manifold3d.Manifold:
    if len(solids) == 1:
        return solids[0]
    union = manifold3d.Manifold.batch_boolean(solids, manifold3d.OpType.Add)
    return checked(union, "uniting buffers")


def _tidied(vertices: Floats, faces: Ints, restrained: Bools) -> tuple[Floats, Ints, Bools]:
    """Simplify an eroded solid; drop its specks and bodies without a free face.

    It is taken in anew first: manifold3d joins coplanar triangles only where they stem
    from one original, and each swept triangle is an original of its own.
    """
    tagged = to_tagged_solid(vertices, faces, restrained)
    bodies = checked(tagged.solid.simplify(SIMPLIFY_MM), "simplifying").decompose()
    kept = [
        body
        for body in bodies
        if body.volume() >= SPECK_MM3 and not from_solid(body, tagged.restrained_id)[2].all()
    ]
    return from_solid(manifold3d.Manifold.compose(kept), tagged.restrained_id)


def _layer(index: int, thickness: float, vertices: Floats, faces: Ints) -> Layer:
    points, faces = compact(vertices, faces)
    return Layer(
        index=index,
        kind="envelope",
        depth_mm=(index + 0.5) * thickness,
        vertices=points,
        faces=faces,
        thickness=np.full(len(points), thickness),
    )
