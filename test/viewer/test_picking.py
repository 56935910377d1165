# SPDX-License-Identifier: Apache-2.0
import numpy as np
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from vega_planner.viewer.picking import first_hit, ray_through_pixel

BALL = trimesh.creation.icosphere(3, 10.0)


@settings(deadline=None, derandomize=True, max_examples=60)
@given(st.integers(0, len(BALL.faces) - 1), st.floats(0.05, 0.9), st.floats(0.05, 0.9))
def test_a_ray_at_a_point_of_a_face_hits_that_face_there(face, a, b):
    """Of a convex body the face that is aimed at from outside is the first that is met."""
    weights = np.array([a, b * (1 - a), (1 - b) * (1 - a)])
    target = weights @ BALL.vertices[BALL.faces[face]]
    eye = 5.0 * BALL.face_normals[face] * 10.0
    hit = first_hit(eye, target - eye, BALL.vertices, BALL.faces)
    assert hit.face == face
    np.testing.assert_allclose(hit.point, target, atol=1e-9)


def test_a_ray_past_the_body_hits_nothing_and_a_masked_face_is_passed():
    eye = np.array([50.0, 0.0, 0.0])
    assert first_hit(eye, np.array([0.0, 1.0, 0.0]), BALL.vertices, BALL.faces) is None
    toward = np.array([-1.0, 1e-3, 2e-3])
    front = first_hit(eye, toward, BALL.vertices, BALL.faces)
    others = np.arange(len(BALL.faces)) != front.face
    behind = first_hit(eye, toward, BALL.vertices, BALL.faces, others)
    assert behind.distance > front.distance + 15.0


def test_the_ray_of_a_pixel_meets_what_a_pinhole_camera_shows_there():
    """Independent answer: project a point with a 4x4 camera matrix, then shoot back at it."""
    from scipy.spatial.transform import Rotation

    pose = Rotation.from_euler("xyz", [0.3, -0.8, 1.2])
    position = np.array([1.0, -2.0, 0.5])
    fov, aspect = 0.9, 4 / 3
    seen = np.array([0.3, -0.2, 2.0])  # x right, y down, z forward
    half = np.tan(fov / 2)
    screen = (
        0.5 + 0.5 * seen[0] / (seen[2] * half * aspect),
        0.5 + 0.5 * seen[1] / (seen[2] * half),
    )
    x, y, z, w = pose.as_quat()
    origin, direction = ray_through_pixel(position, np.array([w, x, y, z]), fov, aspect, screen)
    point = position + pose.apply(seen)
    distance = np.linalg.norm(np.cross(point - origin, direction))
    assert distance < 1e-12
