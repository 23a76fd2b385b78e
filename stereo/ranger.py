"""StereoRanger: a raw pair becomes a range scan.

pair -> rectified pair -> disparity -> nearest obstacle per column -> RangeScan
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from calibration.rig import StereoRig
from stereo.columns import nearest_per_column
from stereo.disparity import SUBPIXEL, DisparityMatcher, choose_disparities
from stereo.errors import StereoError
from stereo.pair import StereoPair
from stereo.rectify import Rectifier
from stereo.scan import RangeScan
from stereo.settings import StereoSettings

# A range is of use while its standard deviation stays below this [m].
USABLE_SIGMA = 0.10
# From this focal length [px] on, two rows joined are still narrower than 6 mm at 1 m.
FINE_ROWS = 350.0
# Share of pixels that must match with the images exchanged before they are called swapped.
SWAPPED_SHARE = 0.25
# And so many times more than as they are: 1.9 to 3 for images exchanged under a rig that is not
# (its rectification then fits badly), at most 0.45 for images in order.
SWAPPED_RATIO = 1.5


@dataclass(frozen=True)
class StereoFrame:
    """One pair with all that was made of it: rectified left image (H, W) uint8, disparity (H, W)
    int16 in sixteenths of a pixel, scan, and the pixels that agree on each of its ranges (n,)."""

    left: np.ndarray
    disparity: np.ndarray
    scan: RangeScan
    support: np.ndarray


# Ranges with a standard deviation of so many times the usable one are unknown. Half of the ranges
# at `max_range` are somewhat less certain than usable; what is far less so only blurs the map.
UNKNOWN_BEYOND = 2.0


class StereoRanger:
    """Range scans from the raw pairs of one rig.

    usable_sigma: m; max_range: m, None: where a disparity error of `settings.noise` grows to that.
    A range of more than twice that standard deviation is no measurement: it would be drawn as a
    dotted line. May be called from several threads at once.
    """

    def __init__(
        self,
        rig: StereoRig,
        settings: StereoSettings | None = None,
        max_range: float | None = None,
        usable_sigma: float = USABLE_SIGMA,
    ):
        self.settings = settings = settings or StereoSettings()
        if settings.disparities is not None and settings.disparities % 16:
            raise StereoError(
                f"stereo.disparities is {settings.disparities}: must be a multiple of 16"
            )
        if settings.disparities is not None and settings.disparities >= rig.image_size[0]:
            raise StereoError(
                f"stereo.disparities is {settings.disparities}: must be less than the image's "
                f"width, {rig.image_size[0]}"
            )
        if settings.block % 2 == 0:
            raise StereoError(f"stereo.block is {settings.block}: must be odd")
        if settings.height_min >= settings.height_max:
            raise StereoError(
                f"stereo.height_min {settings.height_min} m is not below "
                f"stereo.height_max {settings.height_max} m"
            )
        factor = rig.left.fx * rig.baseline
        disparities = settings.disparities or choose_disparities(
            rig.left.fx, rig.baseline, rig.image_size[0]
        )
        heights = (settings.height_min, settings.height_max)
        joined = settings.rows_joined or (2 if rig.left.fx >= FINE_ROWS else 1)
        self.rectify = Rectifier(rig, heights, factor / disparities, joined)
        self.camera = self.rectify.camera
        self.match = DisparityMatcher(self.camera, settings)
        self.max_sigma = UNKNOWN_BEYOND * usable_sigma
        self.max_range = max_range or usable_range(
            self.camera.depth_factor, settings.noise, usable_sigma
        )

    def __call__(self, pair: StereoPair) -> RangeScan:
        """The scan of one pair."""
        return self.frame(pair).scan

    def frame(self, pair: StereoPair) -> StereoFrame:
        """The scan together with the rectified left image and the disparity."""
        left, right = self.rectify(pair.left, pair.right)
        disparity = self.match(left, right)
        found = nearest_per_column(
            disparity,
            (left, right),
            self.rectify.seen,
            self.camera,
            self.settings,
            self.match.disparities,
            self.max_range,
        )
        vague = found.sigma > self.max_sigma
        found.range[vague] = found.sigma[vague] = np.nan
        columns = np.arange(self.camera.width)
        bearing = np.arctan2(self.camera.cx - columns, self.camera.f)
        x, y, _ = self.camera.position
        scan = RangeScan(
            stamp=pair.stamp,
            origin=(float(x), float(y), self.camera.yaw),
            bearing=bearing[::-1].copy(),
            range=found.range[::-1].copy(),
            sigma=found.sigma[::-1].copy(),
            max_range=self.max_range,
        )
        return StereoFrame(left, disparity, scan, found.support[::-1].copy())

    def looks_swapped(self, pair: StereoPair) -> bool:
        """Whether left and right are exchanged: true disparities would then be negative."""
        left, right = self.rectify(pair.left, pair.right)
        straight, exchanged = (
            float(np.mean(self.match(a, b) > 0)) for a, b in ((left, right), (right, left))
        )
        return exchanged > SWAPPED_SHARE and exchanged > SWAPPED_RATIO * straight

    def points(
        self, frame: StereoFrame, raw_left: np.ndarray, step: int = 4
    ) -> tuple[np.ndarray, np.ndarray]:
        """Points (n, 3) float32 [m, robot frame] and their colours (n, 3) uint8 RGB.

        Every `step`-th row and column, up to `max_range` away; `raw_left` gives the colours.
        """
        camera = self.camera
        v, u = np.nonzero(frame.disparity[::step, ::step] > 0)
        u, v = u * step, v * step
        Z = camera.depth_factor * SUBPIXEL / frame.disparity[v, u]
        near = self.max_range >= Z
        u, v, Z = u[near], v[near], Z[near]
        rays = [(u - camera.cx) / camera.f, (v - camera.cy) / camera.f_rows, np.ones(len(u))]
        points = (np.stack(rays) * Z).T @ camera.rotation.T + camera.position
        colours = frame.left if raw_left.ndim == 2 else self.rectify.left_in_colour(raw_left)
        picked = colours[v, u]
        rgb = np.repeat(picked[:, None], 3, axis=1) if picked.ndim == 1 else picked[:, ::-1]
        return points.astype(np.float32), rgb


def usable_range(depth_factor: float, noise: float, sigma: float) -> float:
    """Distance [m] at which sigma_z = z^2 noise / (f B) reaches `sigma` [m]."""
    return math.sqrt(sigma * depth_factor / noise)
