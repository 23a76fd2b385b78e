"""The machine: is the disk fast enough to record, the processor to map?"""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from pathlib import Path

import numpy as np

from calibration.rig import StereoRig
from mapping.mapper import HierarchicalMapper
from odometry.motion import Motion
from pipeline.doctor.check import FAIL, PASS, WARN, Check
from pipeline.live.warm_up import warm_up
from pipeline.run import make_ranger
from pipeline.settings import Settings
from stereo.pair import StereoPair
from stereo.scan import RangeScan

BLOCK, BLOCKS = 1 << 20, 24
USUAL_PAIR = 120_000  # bytes of a pair, where none was seen
SPARE = 3.0  # times what is needed
ENOUGH_MINUTES = 10.0
FASTEST = 0.5  # m/s at which observations are due
BUSY = 0.7  # of a core


def disk_check(folder: Path, pair_bytes: float | None, fps: float) -> Check:
    """Write and sync some megabytes at `folder`; what pairs of that size need."""
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            block = np.random.default_rng(0).bytes(BLOCK)
            begin = time.perf_counter()
            for _ in range(BLOCKS):
                file.write(block)
            file.flush()
            os.fsync(file.fileno())
            speed = BLOCK * BLOCKS / (time.perf_counter() - begin)
    except OSError as error:
        return Check("disk", FAIL, f"{folder}: cannot be written ({error.strerror})", "another one")
    need = (pair_bytes or USUAL_PAIR) * fps
    minutes = shutil.disk_usage(folder).free / need / 60.0
    found = (
        f"{speed / 1e6:.0f} MB/s, a recording needs {need / 1e6:.1f}; room for {minutes:.0f} min"
    )
    if speed < need:
        return Check("disk", FAIL, found, "a faster disk, fewer or smaller images")
    if speed < SPARE * need or minutes < ENOUGH_MINUTES:
        return Check("disk", WARN, found, "a faster or emptier disk")
    return Check("disk", PASS, found)


def processor_check(rig: StereoRig, settings: Settings) -> Check:
    """Time an observation, and a local map, on made-up images; what a moving robot needs."""
    warm_up(rig, settings, looks=False)
    width, height = rig.image_size
    noise = np.random.default_rng(1).integers(0, 255, (height, width), np.uint8)
    ranger = make_ranger(rig, settings)
    begin = time.perf_counter()
    for _ in range(3):
        scan = ranger(StereoPair(0, noise, noise))
    stereo = (time.perf_counter() - begin) / 3
    wall = np.full(len(scan.bearing), 2.0)
    seen = RangeScan(0, scan.origin, scan.bearing, wall, 0.01 * wall, scan.max_range)
    mapper = HierarchicalMapper(settings.mapping)
    step = Motion(np.array([0.01, 0.0, 0.0]), np.diag([1e-4, 1e-4, 1e-4]), 0, 1)
    count = 2 * settings.mapping.window
    begin = time.perf_counter()
    for _ in range(count):
        mapper.move(step)
        mapper.observe(seen)
    mapping = (time.perf_counter() - begin) / count
    return _judged(stereo, mapping, settings)


def _judged(stereo: float, mapping: float, settings: Settings) -> Check:
    each = stereo + mapping
    due = FASTEST / max(settings.mapping.spacing, 0.01)
    found = (
        f"{1000 * stereo:.0f} ms of stereo and {1000 * mapping:.0f} ms of mapping an observation: "
        f"{1.0 / each:.0f} a second; {due:.0f} are due at {FASTEST:g} m/s"
    )
    remedy = "fewer mapping.particles, smaller images, or stereo.disparities"
    if each * due > 1.0:
        return Check("processor", FAIL, found, remedy)
    if each * due > BUSY:
        return Check("processor", WARN, found, remedy)
    return Check("processor", PASS, found)
