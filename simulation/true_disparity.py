"""True disparity: where the point of a left pixel appears in the right image.

What the right camera cannot see (hidden by something nearer, or beside its image) has a disparity
all the same.
"""

from __future__ import annotations

import numpy as np

from calibration.rig import RigError, StereoRig
from simulation.camera_rays import camera_poses, distort, pixel_rays
from simulation.tracer import Tracer
from stereo.rectify import RectifiedCamera


def raw_disparity(rig: StereoRig, depth: np.ndarray) -> np.ndarray:
    """(H, W, 2) float32 px: left pixel (u, v) minus the right one that shows the same point, both
    raw; NaN where there is nothing.

    depth: (H, W) m along the raw left camera's optical axis, inf where nothing, as rendered.
    """
    height, width = depth.shape
    rays = pixel_rays(rig.left, (width, height), 1)[:, 0]
    there = np.isfinite(depth).ravel()
    points = rays[there] * depth.ravel()[there, None] @ rig.R.T + rig.T
    v, u = np.divmod(np.flatnonzero(there), width)
    moved = np.full((height * width, 2), np.nan, np.float32)
    seen = distort(rig.right, points[:, :2] / points[:, 2:])
    moved[there] = np.stack([u, v], axis=1) - seen
    return moved.reshape(height, width, 2)


def rectified_disparity(
    tracer: Tracer, rig: StereoRig, camera: RectifiedCamera, pose: np.ndarray, time: float = 0.0
) -> np.ndarray:
    """(camera.height, camera.width) float32 px, true at the centres of the rectified left image's
    pixels, as a `StereoRanger` of `rig` matches them; 0 where there is nothing.

    Raises:
        RigError: the rig has no mount.
    """
    if rig.mount is None:
        raise RigError("rig: field 'mount' is missing: what the cameras see depends on it")
    x = (np.arange(camera.width) - camera.cx) / camera.f
    y = (np.arange(camera.height) - camera.cy) / camera.f
    local = np.stack([*np.meshgrid(x, y), np.ones((camera.height, camera.width))], axis=-1)
    rotation, position = camera_poses(rig, pose)[0]
    world_from_robot = rotation @ rig.mount.rotation.T
    rays = np.empty((camera.height, camera.width, 6), np.float32)
    rays[..., :3] = position
    rays[..., 3:] = local @ (world_from_robot @ camera.rotation).T
    return (camera.depth_factor / tracer.depth(rays, time)).astype(np.float32)
