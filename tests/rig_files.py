"""Random rigs for the tests of rig files."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
from hypothesis import strategies as st

from calibration.rig import CameraModel, Mount, StereoRig

# Mild lenses: what a real one has, so that rectification has something to look at.
COEFFICIENTS = {"none": 0, "radtan": 4, "radtan5": 5, "rational": 8, "fisheye": 4}
small = st.floats(0.001, 0.05) | st.floats(-0.05, -0.001)


def cameras(lens: str) -> st.SearchStrategy[CameraModel]:
    """Cameras of about 640x480 with this lens; none of its coefficients is 0."""
    count = COEFFICIENTS[lens]
    return st.builds(
        CameraModel,
        fx=st.floats(400.0, 700.0),
        fy=st.floats(400.0, 700.0),
        cx=st.floats(280.0, 360.0),
        cy=st.floats(200.0, 280.0),
        distortion_model=st.just("radtan" if lens == "radtan5" else lens),
        distortion=st.tuples(*[small] * count),
    )


@st.composite
def rigs(draw, lenses: tuple[str, ...] = tuple(COEFFICIENTS)) -> StereoRig:
    """Both cameras with one of these lenses, turned by up to 10 degrees a side."""
    lens = draw(st.sampled_from(lenses))
    angles = draw(st.tuples(*[st.floats(-10.0, 10.0)] * 3))
    R, _ = cv2.Rodrigues(np.radians(np.array(angles)))
    baseline = draw(st.floats(0.03, 0.5))
    position = np.array([baseline, draw(st.floats(-0.01, 0.01)), draw(st.floats(-0.01, 0.01))])
    return StereoRig((640, 480), draw(cameras(lens)), draw(cameras(lens)), R, -R @ position)


def one_rig(**changes) -> StereoRig:
    """A rig with all of it: two lenses, a turned camera, a mount, encoders."""
    R, _ = cv2.Rodrigues(np.radians([0.8, 2.3, -0.6]))
    rig = StereoRig(
        (640, 480),
        CameraModel(536.1, 535.7, 342.3, 235.6, "radtan", (-0.27, 0.05, 0.0012, -0.0003)),
        CameraModel(539.2, 538.8, 327.1, 249.8, "radtan", (-0.28, 0.08, -0.0004, 0.0002)),
        R,
        -R @ np.array([0.0834, 0.001, -0.002]),
        mount=Mount(0.31, math.radians(12.0), 0.01, -0.02, 0.1, 0.06),
        sections={"encoders": {"track": 0.3}, "calibration": {"date": "2026-01-02"}},
    )
    return replace(rig, **changes)


def assert_same_rig(again: StereoRig, rig: StereoRig, tolerance: float = 0.0) -> None:
    """The cameras and the pose between them are the same; R, T within `tolerance`."""
    assert (again.image_size, again.left, again.right) == (rig.image_size, rig.left, rig.right)
    np.testing.assert_allclose(again.R, rig.R, rtol=0.0, atol=tolerance)
    np.testing.assert_allclose(again.T, rig.T, rtol=0.0, atol=tolerance)
