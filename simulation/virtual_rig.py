"""VirtualRig: a robot that drives through a recording behind real interfaces.

with VirtualRig(drive, folder, protocol="stream", faults=(parse_fault("unplug@12s"),)) as rig:
    ...  # rig.devices: what stands under `devices` in a rig file
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from simulation.virtual_boards import make_board
from simulation.virtual_cameras import VirtualCameras
from simulation.virtual_drive import RecordedDrive, Timeline
from simulation.virtual_encoders import VirtualEncoders
from simulation.virtual_faults import Fault


class VirtualRig:
    """Two network cameras and an encoder board; both keep to one clock.

    folder: where the port's name appears. speed: times the recorded one. It drives off when both
    cameras are watched.
    """

    def __init__(
        self,
        drive: RecordedDrive,
        folder: Path,
        protocol: str = "stream",
        faults: tuple[Fault, ...] = (),
        speed: float = 1.0,
        port: int = 0,
    ) -> None:
        self.drive = drive
        self.protocol = protocol
        self.timeline = Timeline(drive, speed)
        board = make_board(protocol, drive.encoders.ticks_per_revolution)
        self.cameras = VirtualCameras(self.timeline, faults, port)
        self.encoders = VirtualEncoders(folder, self.timeline, board, faults)

    @property
    def devices(self) -> dict[str, Any]:
        """The section of a rig file."""
        return {
            "left": self.cameras.address("left"),
            "right": self.cameras.address("right"),
            "fps": round(self.timeline.speed / self.drive.period, 3),
            "encoders": self.encoders.pattern,
            "protocol": self.protocol,
        }

    def __enter__(self) -> VirtualRig:
        self.encoders.start()
        self.cameras.start()
        return self

    def __exit__(self, *_exception: object) -> None:
        self.cameras.stop()
        self.encoders.stop()
