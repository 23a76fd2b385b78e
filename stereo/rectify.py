"""Rectification: both images as two level, parallel cameras would see them.

The virtual cameras share the baseline as their x axis, so that a point lies on the same row in
both images, and are turned about the baseline until they look along the floor. A pitched
camera's columns are then exact bearings (Hartley and Zisserman 2004, Sec. 11.12, with the free
rotation about the baseline fixed by the mount). Only the rows that can hold obstacles are made.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from calibration.rig import CameraModel, Mount, StereoRig
from stereo.errors import StereoError

# Rows above and below the band that SGBM needs to aggregate its costs.
BAND_MARGIN = 12
# So near [px] to what a camera did not see, a block or a gradient holds some of it.
RIM = 3
# In fewer rows a matcher's block finds nothing.
LEAST_ROWS = 8

# How far, as a cosine, the baseline may lean out of the image rows and out of the floor plane.
LEAST_SIDEWAYS = 0.5


@dataclass(frozen=True)
class RectifiedCamera:
    """Geometry of the rectified left camera: lengths in pixels and metres.

    rotation: (3, 3) from its axes (x right, y down, z forward) to the robot's;
    position: (3,) of its optical centre on the robot;
    rows_joined: rows of the camera that were averaged into each row of the image.
    """

    width: int
    height: int
    f: float
    cx: float
    cy: float
    baseline: float
    rotation: np.ndarray
    position: np.ndarray
    rows_joined: int = 1

    @property
    def f_rows(self) -> float:
        """Focal length in rows of the image [px]."""
        return self.f / self.rows_joined

    @property
    def depth_factor(self) -> float:
        """f B: depth in metres = depth_factor / disparity in pixels."""
        return self.f * self.baseline

    @property
    def yaw(self) -> float:
        """Direction of the optical axis in the robot's plane [rad]."""
        return float(np.arctan2(self.rotation[1, 2], self.rotation[0, 2]))


class Rectifier:
    """Turns raw pairs of one rig into rectified ones.

    heights: (lowest, highest) height of interest on the robot [m]; nearest: closest distance of
    interest [m]; rows_joined: rows of the camera averaged into one. Without a mount on the rig
    the camera is taken as level, 0.3 m high.
    """

    def __init__(
        self,
        rig: StereoRig,
        heights: tuple[float, float],
        nearest: float,
        rows_joined: int = 1,
    ):
        self.rig = rig
        mount = rig.mount or Mount()
        left_from_raw, right_from_raw = _rectifying_rotations(rig, mount)
        f = (rig.left.fx + rig.left.fy + rig.right.fx + rig.right.fy) / 4.0
        if rig.rectified:
            f = rig.left.fx
        width, height = rig.image_size
        rays = (
            _border_rays(rig.left, rig.image_size) @ left_from_raw.T,
            _border_rays(rig.right, rig.image_size) @ right_from_raw.T,
        )
        cx, cy = _principal_point(rig, f, rays, left_from_raw)
        least = LEAST_ROWS * rows_joined
        top, bottom = _band_rows(f, cy, mount.height, heights, nearest, rays, least)
        rows = (bottom - top) // rows_joined
        self.camera = RectifiedCamera(
            width=width,
            height=rows,
            f=f,
            cx=cx,
            # Pixel centres are at integers: row 0 of two joined ones lies between rows 0 and 1.
            cy=(cy - top + 0.5) / rows_joined - 0.5,
            baseline=rig.baseline,
            rotation=mount.rotation @ left_from_raw.T,
            position=mount.position,
            rows_joined=rows_joined,
        )
        # Already rectified and level images need only be cut to the band.
        self._rows = slice(top, bottom)
        self._cut_only = (
            rig.rectified
            and rows_joined == 1
            and np.allclose(left_from_raw, np.eye(3), atol=1e-9)
            and top >= 0
            and bottom <= height
        )
        if not self._cut_only:
            f_rows, cy = self.camera.f_rows, self.camera.cy
            P = np.array([[f, 0.0, cx], [0.0, f_rows, cy], [0.0, 0.0, 1.0]])
            size = (width, rows)
            # Between two rows, where joined rows have their centres, a bilinear sample is the
            # mean of both.
            self._left_maps = _maps(rig.left, left_from_raw, P, size)
            self._right_maps = _maps(rig.right, right_from_raw, P, size)
        self.seen = self._seen_columns()

    def __call__(self, left: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rectified grey images, uint8 (camera.height, camera.width) each.

        Raises StereoError when the images do not have the rig's size.
        """
        width, height = self.rig.image_size
        for name, image in (("left", left), ("right", right)):
            if image.shape[:2] != (height, width):
                raise StereoError(
                    f"the {name} image is {image.shape[1]}x{image.shape[0]}, the rig is calibrated "
                    f"for {width}x{height}: use the rig made for these images"
                )
        left, right = _eight_bits(_grey(left), _grey(right))
        if self._cut_only:
            return left[self._rows], right[self._rows]
        return (
            cv2.remap(left, *self._left_maps, cv2.INTER_LINEAR),
            cv2.remap(right, *self._right_maps, cv2.INTER_LINEAR),
        )

    def _seen_columns(self) -> np.ndarray:
        """(4, height) int32: first column and one past the last that the left, then the right
        camera saw, in every row. What lies outside is black and matches itself, and so does its
        outline as far as it reaches into blocks and gradients."""
        width, height = self.rig.image_size
        white = np.full((height, width), 255, np.uint8)
        reach = np.ones((2 * RIM + 1, 2 * RIM + 1), np.uint8)
        inner = [cv2.erode(image, reach) == 255 for image in self(white, white)]
        limits = [_longest_run(row) for image in inner for row in image]
        return np.array(limits, np.int32).reshape(2, -1, 2).transpose(0, 2, 1).reshape(4, -1)

    def left_in_colour(self, left: np.ndarray) -> np.ndarray:
        """The rectified left image with its colours, uint8, for people and clouds."""
        left, _ = _eight_bits(left, left)
        if self._cut_only:
            return left[self._rows]
        return cv2.remap(left, *self._left_maps, cv2.INTER_LINEAR)


def _rectifying_rotations(rig: StereoRig, mount: Mount) -> tuple[np.ndarray, np.ndarray]:
    """Rotations from each raw camera's axes to the rectified axes."""
    x = -rig.R.T @ rig.T / np.linalg.norm(rig.T)
    if x[0] < -LEAST_SIDEWAYS:
        raise StereoError(
            "the rig's right camera lies to the left of its left camera (T has a positive x): "
            "exchange the left and right images and calibrate again"
        )
    if x[0] < LEAST_SIDEWAYS:
        raise StereoError(
            f"the rig's cameras do not stand side by side (T is {np.round(rig.T, 4).tolist()} m): "
            "check T, or mount them beside each other"
        )
    down = -mount.rotation.T @ np.array([0.0, 0.0, 1.0])
    y = down - (down @ x) * x
    if np.linalg.norm(y) < LEAST_SIDEWAYS:
        raise StereoError(
            "the rig's baseline stands upright on the robot: columns of the image are then no "
            "bearings: check the mount's roll (degrees)"
        )
    y /= np.linalg.norm(y)
    left_from_raw = np.stack([x, y, np.cross(x, y)])
    return left_from_raw, left_from_raw @ rig.R.T


def _border_rays(camera: CameraModel, size: tuple[int, int]) -> np.ndarray:
    """Unit-depth rays (n, 3) through points along the image's border and through its centre."""
    width, height = size
    u, v = np.linspace(0, width - 1, 9), np.linspace(0, height - 1, 9)
    border = np.concatenate(
        [
            np.stack([u, np.zeros(9)], 1),
            np.stack([u, np.full(9, height - 1.0)], 1),
            np.stack([np.zeros(9), v], 1),
            np.stack([np.full(9, width - 1.0), v], 1),
            [[(width - 1) / 2.0, (height - 1) / 2.0]],
        ]
    ).astype(np.float64)[:, None, :]
    undistort = (
        cv2.fisheye.undistortPoints if camera.distortion_model == "fisheye" else cv2.undistortPoints
    )
    flat = np.asarray(undistort(border, camera.K, camera.D)).reshape(-1, 2)
    return np.column_stack([flat, np.ones(len(flat))])


def _principal_point(
    rig: StereoRig,
    f: float,
    rays: tuple[np.ndarray, np.ndarray],
    left_from_raw: np.ndarray,
) -> tuple[float, float]:
    """Columns centred on what both cameras see; rows as in the left image."""
    if rig.rectified and np.allclose(left_from_raw, np.eye(3), atol=1e-9):
        return rig.left.cx, rig.left.cy
    centres = [r[-1, :2] / r[-1, 2] for r in rays]
    width, height = rig.image_size
    x, y = np.mean(centres, axis=0)
    return (width - 1) / 2.0 - f * float(x), (height - 1) / 2.0 - f * float(y)


def _band_rows(
    f: float,
    cy: float,
    camera_height: float,
    heights: tuple[float, float],
    nearest: float,
    rays: tuple[np.ndarray, np.ndarray],
    least: int,
) -> tuple[int, int]:
    """First and one past the last row that both show something and can hold obstacles."""
    ahead = np.concatenate([r[r[:, 2] > 0.05] for r in rays])
    seen = ahead[:, 1] / ahead[:, 2] if len(ahead) else np.zeros(1)
    slopes = (camera_height - np.array(heights)) / nearest  # of the band's edges, y down
    top = max(float(seen.min()), min(float(slopes[1]), 0.0))
    bottom = min(float(seen.max()), max(float(slopes[0]), 0.0))
    first = int(np.floor(max(cy + f * top - BAND_MARGIN, cy + f * seen.min())))
    last = int(np.ceil(min(cy + f * bottom + BAND_MARGIN, cy + f * seen.max())))
    if last + 1 - first < least:
        raise StereoError(
            f"no image row can hold an obstacle between {heights[0]} and {heights[1]} m: "
            "check the rig's mount (height, pitch in degrees, nose down positive)"
        )
    return first, last + 1


def _longest_run(row: np.ndarray) -> tuple[int, int]:
    """First and one past the last of the most neighbours that are true; of a lens with barrel
    distortion the outermost rows show the image's corners alone, with nothing between them."""
    edges = np.flatnonzero(np.diff(row.astype(np.int8), prepend=0, append=0)).reshape(-1, 2)
    if not len(edges):
        return row.size, 0
    first, last = edges[np.argmax(edges[:, 1] - edges[:, 0])]
    return int(first), int(last)


def _maps(camera: CameraModel, R: np.ndarray, P: np.ndarray, size: tuple[int, int]):
    """Fixed-point remap tables for one camera."""
    if camera.distortion_model == "fisheye":
        return cv2.fisheye.initUndistortRectifyMap(camera.K, camera.D, R, P, size, cv2.CV_16SC2)
    return cv2.initUndistortRectifyMap(camera.K, camera.D, R, P, size, cv2.CV_16SC2)


def _grey(image: np.ndarray) -> np.ndarray:
    return image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)


def _eight_bits(left: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Deeper images scaled to 8 bits, both alike, by the least whole number of bits that holds
    them: cameras put 10, 12 or 14 bits into 16."""
    if left.dtype == right.dtype == np.uint8:
        return left, right
    bits = max(8, int(max(left.max(), right.max())).bit_length())
    scale = 255.0 / (2**bits - 1)
    return cv2.convertScaleAbs(left, alpha=scale), cv2.convertScaleAbs(right, alpha=scale)
