"""Everything that is made at the first pair, made before: kernels loaded or compiled, tables."""

from __future__ import annotations

import numpy as np

from calibration.rig import StereoRig
from mapping.mapper import HierarchicalMapper
from odometry.motion import Motion
from pipeline.motion import looking
from pipeline.run import make_ranger
from pipeline.settings import Settings
from stereo.pair import StereoPair
from stereo.scan import RangeScan

LOCAL_MAPS = 2  # the second one is weighed against the first
WALL = 2.0  # m
SHIFT = 8  # px, the disparity of the noise


def warm_up(rig: StereoRig, settings: Settings, looks: bool) -> None:
    """Take a pair of noise and a made-up wall through all stages; nothing of it is kept.

    looks: motion is found from the images, too.
    """
    width, height = rig.image_size
    noise = np.random.default_rng(0).integers(0, 255, (height, width), np.uint8)
    ranger = make_ranger(rig, settings)
    pair = StereoPair(0, noise, noise)
    scan = ranger(pair)
    if looks:
        motion = looking(rig, None, settings, seed=0)
        seen_double = StereoPair(0, noise, np.roll(noise, -SHIFT, axis=1))
        for stamp in range(3):
            motion.step(stamp, motion.prepare(seen_double))
    wall = np.full(len(scan.bearing), WALL)
    seen = RangeScan(0, scan.origin, scan.bearing, wall, 0.01 * wall, scan.max_range)
    mapper = HierarchicalMapper(settings.mapping)
    step = Motion(np.array([0.01, 0.0, 0.0]), np.diag([1e-4, 1e-4, 1e-4]), 0, 1)
    for _ in range(LOCAL_MAPS * settings.mapping.window):
        mapper.move(step)
        mapper.observe(seen)
    mapper.grid()
    mapper.path()
