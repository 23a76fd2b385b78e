"""What a live run tells the robot: its pose after every pair, and every new map."""

from __future__ import annotations

import json
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

import numpy as np

from pipeline.errors import InputError


@dataclass(frozen=True, eq=False)
class PoseEvent:
    """stamp: of the pair [ns, monotonic]; pose: (x m, y m, theta rad) in the map; latency: from
    the image to here [s]; observed: it was an observation."""

    stamp: int
    pose: np.ndarray
    latency: float
    observed: bool

    def as_json(self) -> str:
        """One line."""
        x, y, theta = (round(float(v), 6) for v in self.pose)
        return json.dumps(
            {
                "type": "pose",
                "stamp": self.stamp,
                "x": x,
                "y": y,
                "theta": theta,
                "latency": round(self.latency, 4),
                "observed": self.observed,
            }
        )


@dataclass(frozen=True)
class MapEvent:
    """file: the map_server YAML, which is whole; stamp: of the last observation in it [ns];
    latency: from the local map's end to the files' being in place [s]."""

    stamp: int
    file: Path
    local_maps: int
    latency: float

    def as_json(self) -> str:
        """One line."""
        return json.dumps(
            {
                "type": "map",
                "stamp": self.stamp,
                "file": str(self.file),
                "local_maps": self.local_maps,
                "latency": round(self.latency, 4),
            }
        )


OnPose = Callable[[PoseEvent], None]
OnMap = Callable[[MapEvent], None]


class EventLines:
    """Writes events as JSON lines into a file, a pipe, or (`-`) to standard output.

    Raises:
        InputError: it cannot be written, or is no file's name: nothing is sent over a network.
    """

    def __init__(self, name: str) -> None:
        if "://" in name:
            raise InputError(f"--poses {name}: give a file, a named pipe, or -: no address")
        self._lock = threading.Lock()
        self._file: TextIO | None = sys.stdout
        self._own = name != "-"
        if self._own:
            try:
                self._file = open(name, "w", encoding="ascii")  # noqa: SIM115
            except OSError as error:
                raise InputError(f"--poses {name}: cannot be written ({error.strerror})") from None

    def __call__(self, event: PoseEvent | MapEvent) -> None:
        """Write one line at once; a reader who has gone ends the lines, not the run."""
        with self._lock:
            if self._file is None:
                return
            try:
                self._file.write(event.as_json() + "\n")
                self._file.flush()
            except OSError:
                self._file = None

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            file, self._file = self._file, None
        if self._own and file is not None:
            file.close()
