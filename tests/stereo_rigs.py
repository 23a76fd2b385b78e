"""Rigs and images with known geometry for the tests of the stereo stage."""

from __future__ import annotations

import math

import cv2
import numpy as np

from calibration.rig import LEVEL_ROBOT_FROM_CAMERA, CameraModel, Mount, StereoRig
from stereo.rectify import RectifiedCamera

SIZE = (320, 240)  # width, height
SHAPE = (240, 320)
F = 246.4
BASELINE = 0.12


UP = Mount(height=0.6)


def straight_rig(mount: Mount | None = UP) -> StereoRig:
    """Two ideal, parallel cameras."""
    camera = CameraModel(F, F, 159.5, 119.5)
    return StereoRig(SIZE, camera, camera, np.eye(3), np.array([-BASELINE, 0.0, 0.0]), mount=mount)


def crooked_rig(pitch_deg: float, roll_deg: float = 2.0) -> StereoRig:
    """Distorted lenses, toe-in of 2.3 deg, the right camera bent, lifted and set back."""
    left = CameraModel(245.0, 246.0, 161.0, 118.0, "radtan", (-0.08, 0.05, 0.001, -0.0008))
    right = CameraModel(248.0, 247.5, 157.0, 121.5, "radtan", (-0.07, 0.04, -0.0006, 0.001))
    R, _ = cv2.Rodrigues(np.radians([0.8, 2.3, -0.6]))
    T = -R @ np.array([BASELINE, 0.003, -0.002])
    mount = Mount(
        height=0.5,
        pitch=math.radians(pitch_deg),
        roll=math.radians(roll_deg),
        yaw=math.radians(4.0),
        x=0.10,
        y=0.06,
    )
    return StereoRig(SIZE, left, right, R, T, mount=mount)


def project(rig: StereoRig, point: np.ndarray) -> list[np.ndarray]:
    """Where a point (3,) on the robot [m] appears in both raw images: [(2,), (2,)] px."""
    assert rig.mount is not None
    in_left = rig.mount.rotation.T @ (point - rig.mount.position)
    rotation, _ = cv2.Rodrigues(rig.R)
    poses = ((np.zeros(3), np.zeros(3), rig.left), (rotation, rig.T, rig.right))
    return [
        cv2.projectPoints(in_left.reshape(1, 1, 3), r, t, camera.K, camera.D)[0].ravel()
        for r, t, camera in poses
    ]


def level_camera(width: int = 40, height: int = 60) -> RectifiedCamera:
    """f B = 10: 5 px of disparity are 2 m, 10 px are 1 m; 0.6 m up."""
    return RectifiedCamera(
        width=width,
        height=height,
        f=100.0,
        cx=(width - 1) / 2.0,
        cy=(height - 1) / 2.0,
        baseline=0.1,
        rotation=LEVEL_ROBOT_FROM_CAMERA,
        position=np.array([0.0, 0.0, 0.6]),
    )


def texture(shape: tuple[int, int], seed: int = 0) -> np.ndarray:
    """Blotches of a few pixels with strong contrast, uint8 (H, W)."""
    noise = np.random.default_rng(seed).normal(size=shape).astype(np.float32)
    noise = cv2.GaussianBlur(noise, (0, 0), 1.5)
    return np.clip(128.0 + 60.0 * noise / noise.std(), 0, 255).astype(np.uint8)


def wall_pair(depth: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """What `straight_rig` sees of a textured wall at `depth` [m] before it."""
    wide = texture((240, 520), seed)
    v, u = np.indices(SHAPE).astype(np.float32)
    disparity = F * BASELINE / depth
    return (
        cv2.remap(wide, u + 50, v, cv2.INTER_CUBIC),
        cv2.remap(wide, u + np.float32(50 + disparity), v, cv2.INTER_CUBIC),
    )
