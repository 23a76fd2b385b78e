"""StereoRenderer: the light on both raw images of a rig that moves through a scene.

Every subpixel sample's ray is the camera's own model inverted, so the images are bent exactly as
the rig says and have to be rectified like real ones. What the sensor makes of the light is
`simulation.sensor`'s; when each row looks is told here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numba import njit

from calibration.rig import RigError, StereoRig
from simulation.camera_rays import camera_poses, pixel_rays
from simulation.faults import PLAIN, CameraFaults
from simulation.scene import Scene
from simulation.sensor import LightPair, Sensor
from simulation.tracer import Tracer

# The robot's true poses (n, 3) at times (n,) s.
PoseAt = Callable[[np.ndarray], np.ndarray]

ROWS = 32  # rendered at a time: what they need fits the processor's cache
BLUR_STEP = 0.5  # motion between two sub-exposures [px]
MOST_STEPS = 32  # sub-exposures
NEAR = 1.0  # distance for which the motion in the image is reckoned [m]


@dataclass(frozen=True)
class RenderedPair:
    """left, right: (H, W) uint8, raw; depth: (H, W) float32, m along the raw left camera's optical
    axis at the pixel centres, inf where there is nothing."""

    left: np.ndarray
    right: np.ndarray
    depth: np.ndarray


class StereoRenderer:
    """Renders pairs of one rig in one scene, or of one more rig in the scene of a `Tracer`.

    samples: k x k samples per pixel. Of the faults shutter, readout and skew act on the light.
    The same poses, time, frame and seed give the same bytes.

    Raises:
        RigError: the rig has no mount, or its lens model has no ray for some pixel.
    """

    def __init__(
        self,
        scene: Scene | Tracer,
        rig: StereoRig,
        seed: int = 0,
        samples: int = 2,
        faults: CameraFaults = PLAIN,
    ) -> None:
        if rig.mount is None:
            raise RigError("rig: field 'mount' is missing: the renderer must know where it sits")
        self.rig, self.seed, self.faults = rig, seed, faults
        self.sensor = Sensor(rig, faults)
        self.tracer = scene if isinstance(scene, Tracer) else Tracer(scene)
        width, height = rig.image_size
        self._angles = tuple(1.0 / (camera.fx * samples) for camera in (rig.left, rig.right))
        self._directions = tuple(
            pixel_rays(camera, rig.image_size, samples).reshape(height, width, -1, 3)
            for camera in (rig.left, rig.right)
        )
        self._centres = pixel_rays(rig.left, rig.image_size, 1).reshape(height, width, 1, 3)

    def render(self, pose: np.ndarray, frame: int, time: float = 0.0) -> RenderedPair:
        """The pair seen by a robot that stands at `pose` (x m, y m, theta rad) at `time` s;
        `frame` keys the noise."""
        pose_at = standing(pose)
        left, right = self.sensor.expose(self.light(pose_at, time), self.seed, frame)
        return RenderedPair(left, right, self.depth(pose_at, time))

    def light(self, pose_at: PoseAt, time: float = 0.0) -> LightPair:
        """The light on the pair whose stamp is `time` s, on the way `pose_at`."""
        with ThreadPoolExecutor(2) as pool:
            left, right = pool.map(lambda camera: self._light(camera, pose_at, time), (0, 1))
        return LightPair(left, right)

    def depth(self, pose_at: PoseAt, time: float = 0.0) -> np.ndarray:
        """(H, W) float32, as in `RenderedPair`: of what each row of the left image looked at in
        the middle of its exposure."""
        height, width = self._centres.shape[:2]
        depth = np.empty((height, width), np.float32)
        for rows, times in self._blocks(0, time):
            rays = self._rays(0, self._centres[rows], pose_at(times))
            depth[rows] = self.tracer.depth(rays, float(times.mean()))[..., 0]
        return depth

    def _light(self, camera: int, pose_at: PoseAt, time: float) -> np.ndarray:
        directions = self._directions[camera]
        height, width, samples = directions.shape[:3]
        light = np.empty((height, width), np.float32)
        rounds = self._moments(pose_at, time, samples)
        for rows, times in self._blocks(camera, time):
            total = np.zeros((times.size, width))
            for moments in rounds:
                moments = times[:, None] + moments
                rays = self._rays(camera, directions[rows], pose_at(moments.ravel()))
                rays = rays.reshape(-1, *rays.shape[2:])
                seen = self.tracer.linear(rays, self._angles[camera], float(moments.mean()))
                total += seen.reshape(total.shape)
            light[rows] = total / len(rounds)
        return light

    def _moments(self, pose_at: PoseAt, time: float, samples: int) -> np.ndarray:
        """(rounds, samples) s, or (1, 1) with no shutter: when each of a pixel's samples looks,
        about the middle of its row's exposure. As many rounds as keep what moves together, and an
        even number, forth and back, so that no sample is the late one."""
        shutter = self.faults.shutter
        if not shutter:
            return np.zeros((1, 1))
        ends = pose_at(time + 0.5 * shutter * np.array([-1.0, 1.0]))
        x, y, turn = np.abs(ends[1] - ends[0])
        motion = self.rig.left.fx * (turn + math.hypot(x, y) / NEAR)
        steps = min(motion / BLUR_STEP, MOST_STEPS)
        rounds = 2 * max(1, math.ceil(steps / (2 * samples)))
        moments = shutter * ((np.arange(rounds * samples) + 0.5) / (rounds * samples) - 0.5)
        moments = moments.reshape(rounds, samples)
        moments[1::2] = moments[1::2, ::-1]
        return moments

    def _blocks(self, camera: int, time: float) -> Iterator[tuple[slice, np.ndarray]]:
        """Rows of one camera's image, and the middles of their exposures [s]."""
        height = self.rig.image_size[1]
        offset = ((np.arange(height) + 0.5) / height - 0.5) * self.faults.readout
        times = time + camera * self.faults.skew + offset
        for first in range(0, height, ROWS):
            rows = slice(first, first + ROWS)
            yield rows, times[rows]

    def _rays(self, camera: int, directions: np.ndarray, poses: np.ndarray) -> np.ndarray:
        """Rays (h, W, k, 6) float32 of `directions` (h, W, k, 3), each row from its own pose, or
        each of its samples: poses (h, 3) or (h * k, 3)."""
        h, _, k = directions.shape[:3]
        rotations, positions = camera_poses(self.rig, poses.reshape(h, -1, 3))[camera]
        rotations = np.broadcast_to(rotations, (h, k, 3, 3)).astype(np.float32)
        positions = np.broadcast_to(positions, (h, k, 3)).astype(np.float32)
        return placed(directions, rotations, positions)


def standing(pose: np.ndarray) -> PoseAt:
    """The way of a robot that stays at `pose`."""
    fixed = np.asarray(pose, float)
    return lambda times: np.broadcast_to(fixed, (np.size(times), 3))


@njit(cache=True, nogil=True)
def placed(directions, rotations, positions):
    """Rays (h, W, k, 6) float32 in the world: the directions (h, W, k, 3) of sample s of row i
    turned by rotations[i, s] (3, 3) and starting at positions[i, s] (3,)."""
    h, width, samples, _ = directions.shape
    rays = np.empty((h, width, samples, 6), np.float32)
    for i in range(h):
        for j in range(width):
            for s in range(samples):
                R, p = rotations[i, s], positions[i, s]
                x, y, z = directions[i, j, s]
                for axis in range(3):
                    rays[i, j, s, axis] = p[axis]
                    rays[i, j, s, 3 + axis] = R[axis, 0] * x + R[axis, 1] * y + R[axis, 2] * z
    return rays
