# SPDX-License-Identifier: Apache-2.0
"""A driver takes a job whose certificate is its own and tells of no collision."""

import json

import pytest

from vega_planner.errors import CertificateMismatch
from vega_robot_driver.job import check_certificate

from .synthetic import zigzag_job


def certificate(job, **values):
    return json.dumps({"sha256": {"job": job.digest()}, **values})


def test_a_job_with_its_own_certificate_is_taken():
    job = zigzag_job()
    check_certificate(job, certificate(job))
    check_certificate(job, certificate(job, collision_free=True))


@pytest.mark.parametrize(
    "check, words",
    [
        ({"colliding_waypoints": 3, "touching_samples": 0, "touching_links": []}, ["3 waypoints"]),
        (
            {"colliding_waypoints": 0, "touching_samples": 9, "touching_links": ["arm: plate"]},
            ["9 samples", "arm: plate"],
        ),
        (None, ["unknown waypoints"]),
    ],
)
def test_a_job_that_collides_is_refused(check, words):
    job = zigzag_job()
    with pytest.raises(CertificateMismatch, match="collides") as caught:
        check_certificate(job, certificate(job, collision_free=False, check=check))
    for word in words:
        assert word in str(caught.value)
