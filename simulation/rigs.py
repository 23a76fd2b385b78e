"""The virtual rigs of the rendered recordings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calibration.rig import StereoRig, minibee

# A few tenths of a degree between the cameras and mild lenses: enough that images which were not
# rectified give no usable disparity, as with a pair of cheap webcams.
LEFT_LENS = (-0.050, 0.030, 2.0e-4, -1.0e-4)
RIGHT_LENS = (-0.046, 0.026, -1.5e-4, 1.8e-4)
RIGHT_TURN = np.radians([0.30, -0.35, 0.25])  # rotation vector, right camera from left


def bent_minibee(factor: float = 1.0) -> StereoRig:
    """`minibee` at `factor` times its image size, with radtan lenses and a slight misalignment."""
    rig = minibee().scaled(factor)
    R = _rotation(RIGHT_TURN)
    return replace(
        rig,
        left=replace(rig.left, distortion_model="radtan", distortion=LEFT_LENS),
        right=replace(rig.right, distortion_model="radtan", distortion=RIGHT_LENS),
        R=R,
        T=R @ rig.T,
    )


def with_baseline(rig: StereoRig, baseline: float) -> StereoRig:
    """The same cameras `baseline` m apart, the middle between them where it was on the robot."""
    T = rig.T * (baseline / rig.baseline)
    if rig.mount is None:
        return replace(rig, T=T)
    # From the left camera to the right one is -R^T T, in the left camera's axes.
    shift = 0.5 * rig.mount.rotation @ rig.R.T @ (T - rig.T)
    x, y, height = rig.mount.position + shift
    return replace(rig, T=T, mount=replace(rig.mount, x=x, y=y, height=height))


def _rotation(vector: np.ndarray) -> np.ndarray:
    """Rotation matrix of a rotation vector (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * (cross @ cross)
