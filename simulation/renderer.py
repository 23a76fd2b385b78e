"""StereoRenderer: what the two cameras of a rig see in a scene, lens and sensor included.

Every subpixel sample's ray is the camera's own model inverted, so the images are bent exactly as
the rig says and have to be rectified like real ones.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import numpy as np

from calibration.rig import CameraModel, RigError, StereoRig
from simulation.scene import Scene
from simulation.tracer import Tracer

NOISE_PURPOSE = 1  # keys of the random generators: (seed, purpose, camera, frame)
NOISE_SIGMA = 1.7  # grey levels


@dataclass(frozen=True)
class RenderedPair:
    """left, right: (H, W) uint8, raw; depth: (H, W) float32, m along the raw left camera's optical
    axis at the pixel centres, inf where there is nothing."""

    left: np.ndarray
    right: np.ndarray
    depth: np.ndarray


class StereoRenderer:
    """Renders pairs of one rig in one scene.

    samples: k x k samples per pixel. The same pose, frame and seed give the same bytes.

    Raises:
        RigError: the rig has no mount, or its lens model has no ray for some pixel.
    """

    def __init__(self, scene: Scene, rig: StereoRig, seed: int = 0, samples: int = 2) -> None:
        if rig.mount is None:
            raise RigError("rig: field 'mount' is missing: the renderer must know where it sits")
        self.rig, self.seed = rig, seed
        self._tracer = Tracer(scene)
        self._angles = tuple(1.0 / (camera.fx * samples) for camera in (rig.left, rig.right))
        self._directions = tuple(
            pixel_rays(camera, rig.image_size, samples) for camera in (rig.left, rig.right)
        )
        self._centres = pixel_rays(rig.left, rig.image_size, 1)

    def render(self, pose: np.ndarray, frame: int) -> RenderedPair:
        """The pair seen from the robot's `pose` (x m, y m, theta rad); `frame` keys the noise."""
        views = camera_poses(self.rig, pose)
        rays = [_place(d, *view) for d, view in zip(self._directions, views, strict=True)]
        with ThreadPoolExecutor(2) as pool:
            images = list(pool.map(self._image, rays, self._angles, (0, 1), (frame, frame)))
        depth = self._tracer.depth(_place(self._centres, *views[0]))
        width, height = self.rig.image_size
        return RenderedPair(images[0], images[1], depth.reshape(height, width))

    def _image(self, rays: np.ndarray, angle: float, camera: int, frame: int) -> np.ndarray:
        grey = self._tracer.grey(rays, angle)
        chance = np.random.default_rng((self.seed, NOISE_PURPOSE, camera, frame))
        grey += NOISE_SIGMA * chance.standard_normal(len(grey), np.float32)
        width, height = self.rig.image_size
        return np.clip(np.rint(grey), 0, 255).astype(np.uint8).reshape(height, width)


def pixel_rays(camera: CameraModel, image_size: tuple[int, int], samples: int) -> np.ndarray:
    """Directions (H * W, samples^2, 3) float32 with z = 1 in the camera's frame.

    The samples of a pixel stand on a regular grid within it; one sample stands at its centre.
    """
    width, height = image_size
    offset = (np.arange(samples) + 0.5) / samples - 0.5
    v, u, dv, du = np.meshgrid(np.arange(height), np.arange(width), offset, offset, indexing="ij")
    pixels = np.stack([u + du, v + dv], axis=-1).reshape(-1, 2)
    x, y = undistort(camera, pixels).T
    return (
        np.stack([x, y, np.ones_like(x)], axis=-1)
        .astype(np.float32)
        .reshape(width * height, samples * samples, 3)
    )


def undistort(camera: CameraModel, pixels: np.ndarray) -> np.ndarray:
    """Normalised image coordinates (n, 2) of distorted `pixels` (n, 2).

    Raises:
        RigError: the model cannot be inverted there to 0.01 px (coefficients out of bounds).
    """
    flat = pixels.reshape(-1, 1, 2)
    if camera.distortion_model == "fisheye":
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)
        points = cv2.fisheye.undistortPoints(flat, camera.K, camera.D, criteria=criteria)
    else:
        points = cv2.undistortPoints(flat, camera.K, camera.D)
    points = points.reshape(-1, 2)
    # OpenCV stops after five rounds; repeat until the point projects to its pixel.
    for _ in range(60):
        error = pixels - distort(camera, points)
        if np.abs(error).max() < 1e-6:
            break
        points = points + error / (camera.fx, camera.fy)
    worst = np.abs(pixels - distort(camera, points)).max()
    if not worst < 0.01:
        raise RigError(
            f"rig: distortion {camera.distortion} cannot be inverted over the whole image "
            f"({worst:.3g} px off): check the coefficients"
        )
    return points


def distort(camera: CameraModel, points: np.ndarray) -> np.ndarray:
    """Pixels (n, 2) of normalised image coordinates `points` (n, 2)."""
    if camera.distortion_model == "fisheye":
        flat = points.reshape(-1, 1, 2)
        return cv2.fisheye.distortPoints(flat, camera.K, camera.D).reshape(-1, 2)
    ahead = np.concatenate([points, np.ones((len(points), 1))], axis=1)
    zero = np.zeros(3)
    return cv2.projectPoints(ahead, zero, zero, camera.K, camera.D)[0].reshape(-1, 2)


def camera_poses(rig: StereoRig, pose: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """(rotation (3, 3), position (3,)) of the left and the right camera in the world.

    A rotation carries a direction in the camera's frame to the world's; `rig.mount` must be set.
    """
    x, y, theta = pose
    c, s = math.cos(theta), math.sin(theta)
    world_from_robot = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    assert rig.mount is not None
    left = world_from_robot @ rig.mount.rotation
    position = world_from_robot @ rig.mount.position + (x, y, 0.0)
    right = left @ rig.R.T
    return [(left, position), (right, position - right @ rig.T)]


def _place(directions: np.ndarray, rotation: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Rays (..., 6) float32 in the world."""
    rays = np.empty((*directions.shape[:-1], 6), np.float32)
    rays[..., :3] = position
    rays[..., 3:] = directions @ rotation.T.astype(np.float32)
    return rays
