"""Watcher: somebody who looks at a run while it goes on, and may ask for something."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from pipeline.frontend import Observation
    from pipeline.live.events import MapEvent
    from pipeline.live.map_saver import Snapshot
    from pipeline.recordings.base import Pair
    from pipeline.run import MapRun
    from stereo.camera import CapturedPair
    from stereo.ranger import StereoRanger


@dataclass(frozen=True, eq=False)
class Moment:
    """The latest step of a run.

    pair: None in a scan log; seen: what was observed, where it was due; pose: (3,) of the robot
    in the map, as it is known now; local_maps: how many there are.
    """

    stamp: int
    pair: Pair | None
    seen: Observation | None
    pose: np.ndarray
    local_maps: int


class Watcher:
    """Looks at nothing: what looks overrides some of this.

    Called from the threads that do the work, which a watcher must neither hold up nor change: it
    keeps references to what it is shown, and looks at them elsewhere.
    """

    def begins(self, run: MapRun, ranger: StereoRanger | None) -> None:
        """Before the first pair or scan; ranger: None in a scan log."""

    def captured(self, pair: CapturedPair) -> None:
        """A pair came from the cameras."""

    def mapped(self, moment: Moment) -> None:
        """A pair or a scan was taken in, and has a pose."""

    def wants_map(self) -> bool:
        """Whether the map is asked for now, though it did not grow."""
        return False

    def grew(self, snapshot: Snapshot) -> None:
        """The map grew, or was asked for."""

    def saved(self, event: MapEvent) -> None:
        """Map files are in place."""

    def ended(self, run: MapRun) -> None:
        """The map is finished."""


NOBODY = Watcher()
