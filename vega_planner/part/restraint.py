# SPDX-License-Identifier: Apache-2.0
"""Choosing the buffer restraint region (BRR), the paper's ∂A*, by SPECs.

    none | auto | down | normal:X,Y,Z[:DEG] | point:X,Y,Z | faces:FILE | not:SPEC

Directions and points are given in the part frame, after placement; face indices are
those of `part.ply`, that is of the part after repair. Several SPECs make a union.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from vega_planner.datatypes import Bools, Floats, TriangleGeometry
from vega_planner.errors import BadRestraint
from vega_planner.part.automatic import propose_restraint
from vega_planner.part.regions import smooth_regions, squared_distances
from vega_planner.part.standing import standing_faces
from vega_planner.part.topology import body_labels, compact, enclosed_volume
from vega_planner.settings import PartSettings

SPECS = (
    "none, auto, down, normal:X,Y,Z[:DEG], point:X,Y,Z (region round the nearest face), "
    "faces:FILE (face indices of part.ply), not:SPEC"
)


def choose_restraint(
    mesh: TriangleGeometry, specs: tuple[str, ...], settings: PartSettings
) -> tuple[Bools, list[str]]:
    """Choose the faces of the restraint region.

    Args:
        mesh: The part, closed and oriented, placed on z = 0.
        specs: SPECs whose union is the region; nothing means none.
        settings: For the angles of smooth regions.

    Returns:
        True for restrained faces, shape (m,), and remarks for the person.

    Raises:
        BadRestraint: If a SPEC cannot be understood, selects nothing, or nothing is
            left to buffer.
    """
    chosen = np.zeros(len(mesh.faces), dtype=bool)
    remarks: list[str] = []
    for spec in specs:
        chosen |= _select(mesh, spec.strip(), settings, remarks)
    if chosen.all():
        raise BadRestraint(
            f"restraint {' '.join(specs)} selects the whole surface ({len(chosen)} faces); "
            "at least one face must stay free to be enveloped"
        )
    return chosen, remarks + _unreached(mesh, chosen)


def _unreached(mesh: TriangleGeometry, chosen: Bools) -> list[str]:
    """Tell of bodies restrained all over: no layer starts from them."""
    if not chosen.any():
        return []
    labels = body_labels(mesh.faces)
    free = np.zeros(len(mesh.faces), dtype=bool)
    free[labels[~chosen]] = True
    shut = [name for name in np.unique(labels) if not free[name]]
    volumes = [enclosed_volume(*compact(mesh.vertices, mesh.faces[labels == n])) for n in shut]
    lost = [volume for volume in volumes if volume > 0]
    if not lost:
        return []
    return [
        f"{len(lost)} body(ies) of {sum(lost):.4g} mm³ are restrained all over: layers reach "
        "them from a free cavity only, if they have one"
    ]


def _select(
    mesh: TriangleGeometry, spec: str, settings: PartSettings, remarks: list[str]
) -> Bools:
    kind, _, rest = spec.partition(":")
    if kind == "not":
        return ~_select(mesh, rest.strip(), settings, remarks)
    if kind in ("none", "auto", "down") and rest:
        raise BadRestraint(f"restraint '{spec}': '{kind}' takes no argument")
    if kind == "none":
        return np.zeros(len(mesh.faces), dtype=bool)
    if kind == "auto":
        proposal = propose_restraint(mesh, settings)
        remarks.append(proposal.explanation)
        return proposal.faces
    if kind == "down":
        faces = standing_faces(mesh, settings)
        advice = "the part stands on an edge or a point; try normal:0,0,-1:60 or point:X,Y,Z"
    elif kind == "normal":
        faces = _facing(mesh, spec, rest, settings.smooth_angle_deg)
        advice = "no face looks that way; try a larger angle, normal:X,Y,Z:DEG"
    elif kind == "point":
        faces = _around(mesh, _numbers(spec, rest, 3), settings)
        advice = ""
    elif kind == "faces":
        faces = _listed(spec, rest, len(mesh.faces))
        advice = "the file names no face"
    else:
        raise BadRestraint(f"restraint '{spec}' is not known; choices: {SPECS}")
    if not faces.any():
        raise BadRestraint(f"restraint '{spec}' selects no face: {advice}")
    return faces


def _facing(mesh: TriangleGeometry, spec: str, rest: str, default_deg: float) -> Bools:
    direction, _, angle = rest.partition(":")
    normal = _numbers(spec, direction, 3)
    degrees = _numbers(spec, angle, 1)[0] if angle else default_deg
    length = np.linalg.norm(normal)
    if length == 0:
        raise BadRestraint(f"restraint '{spec}': the direction 0,0,0 points nowhere")
    if not 0 <= degrees <= 180:
        raise BadRestraint(f"restraint '{spec}': angle {degrees:g}; allowed: 0 to 180 degrees")
    cosine = mesh.face_normals @ (normal / length)
    return (cosine >= np.cos(np.radians(degrees)) - 1e-9) & (mesh.face_areas > 0)


def _around(mesh: TriangleGeometry, point: Floats, settings: PartSettings) -> Bools:
    distances = squared_distances(point, mesh.vertices, mesh.faces)
    near = distances <= distances.min() + 1e-12
    # A point on an edge touches several faces: take the one seen most from in front.
    centres = mesh.vertices[mesh.faces].mean(1)
    offset = np.einsum("ij,ij->i", point - centres, mesh.face_normals)
    seed = np.flatnonzero(near)[np.argmax(np.round(offset[near], 9))]
    labels = smooth_regions(mesh, settings.smooth_angle_deg)
    return labels == labels[seed]


def _listed(spec: str, name: str, count: int) -> Bools:
    if not name:
        raise BadRestraint(f"restraint '{spec}' names no file; expected faces:FILE")
    try:
        lines = Path(name).expanduser().read_text(encoding="utf-8").splitlines()
        words = " ".join(line.partition("#")[0] for line in lines).replace(",", " ").split()
        indices = np.array([int(word) for word in words], dtype=np.int64)
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise BadRestraint(f"restraint file {name} cannot be read: {reason}") from error
    except (ValueError, OverflowError) as error:
        raise BadRestraint(
            f"restraint file {name}: expected whole numbers, face indices of part.ply ({error})"
        ) from error
    if len(indices) and (indices.min() < 0 or indices.max() >= count):
        wrong = indices[(indices < 0) | (indices >= count)][0]
        raise BadRestraint(
            f"restraint file {name} names face {wrong}; the part has faces 0 to {count - 1}"
        )
    chosen = np.zeros(count, dtype=bool)
    chosen[indices] = True
    return chosen


def _numbers(spec: str, text: str, count: int) -> Floats:
    try:
        values = np.array([float(word) for word in text.split(",")])
    except ValueError as error:
        raise BadRestraint(f"restraint '{spec}': '{text}' is not {count} number(s)") from error
    if len(values) != count or not np.isfinite(values).all():
        raise BadRestraint(f"restraint '{spec}': '{text}' is not {count} finite number(s)")
    return values
