"""A virtual rig in the test's own process, over a short recording."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pipeline.recordings import open_recording
from pipeline.virtual_rig import recorded_drive, write_rig_file
from simulation.virtual_faults import parse_fault
from simulation.virtual_rig import VirtualRig

# Odometry must believe a robot that drives at this many times its speed.
FAST = ("--set", "odometry.max_speed=100")


@contextmanager
def virtual_rig(
    recording: Path,
    folder: Path,
    *faults: str,
    speed: float = 20.0,
    protocol: str = "stream",
    calibrated: bool = True,
) -> Iterator[VirtualRig]:
    """The rig running; its file is folder/rig.yaml."""
    folder.mkdir(exist_ok=True)
    drive, cameras = recorded_drive(open_recording(recording))
    parsed = tuple(parse_fault(fault) for fault in faults)
    with VirtualRig(drive, folder, protocol, parsed, speed) as virtual:
        write_rig_file(folder / "rig.yaml", cameras, virtual, calibrated)
        yield virtual
