"""RunNews: what changed in a run, as messages to its page.

run        name, phase, figures, checks, notes
picture    codes of the columns, then the left image as JPEG; `strips`: where the columns are
depth      codes of the disparity image
local      the local map so far
map        the global map, with places; `path`, `particles`
pose       of the robot now, and the path since the map
"""

from __future__ import annotations

import secrets
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from mapping.grid import OccupancyGrid
from pipeline.web import run_pictures as pictures
from pipeline.web.encoding import packed
from pipeline.web.messages import Message
from pipeline.web.run_state import ENDED, RunState

# A picture that is mapped is shown, with its columns, unless the newest is so much newer [ns].
LAG = 150_000_000


class RunNews:
    """name: of the run; output: where its map is saved, if it is. Used by one thread."""

    def __init__(self, state: RunState, name: str, output: Path | None) -> None:
        self._state = state
        self._name = name
        self._output = output
        self._id = secrets.token_hex(4)  # a page that finds another run begins anew
        self._sent: dict[str, Any] = {}

    def __iter__(self) -> Iterator[Message]:
        """What changed since the last time."""
        yield from self._run()
        yield from self._picture()
        yield from self._depth()
        yield from self._local()
        yield from self._map()
        yield from self._pose()

    def _run(self) -> Iterator[Message]:
        state = self._state
        values = {
            "id": self._id,
            "name": self._name,
            "phase": state.phase,
            "failure": state.failure,
            "output": None if self._output is None else str(self._output),
            "figures": list(state.figures.items()),
            "checks": list(state.checks.items()),
            "notes": list(state.notes),
            "cameras": state.ranger is not None,
            "farthest": state.ranger.max_range if state.ranger else None,
        }
        if self._sent.get("run") != values:
            self._sent["run"] = values
            yield Message("run", values)

    def _picture(self) -> Iterator[Message]:
        state = self._state
        moment, since = state.moment or (None, 0)
        pair, newest, ranger = moment and moment.pair, state.newest, state.ranger
        if newest is not None and (moment is None or newest.stamp - moment.stamp > LAG):
            pair, since, moment = newest, newest.stamp, None
        if pair is None or not self._is_new("picture", pair):
            return
        image = pictures.left_image(pair)
        if image is None:
            return
        if ranger is not None and self._is_new("strips", ranger):
            edges = pictures.strips(ranger.rectify.rig, ranger.camera)
            yield Message("strips", {}, edges.astype(np.float32).tobytes())
        codes, seen = b"", state.seen
        if moment is not None and ranger is not None and seen is not None:
            tint = pictures.tint(seen.scan, ranger.camera, seen.moment.pose, moment.pose)
            codes = tint.tobytes()
        age = (time.monotonic_ns() - since) / 1e9
        values = {"stamp": since, "age": age, "columns": len(codes), "both": image[1]}
        yield Message("picture", values, codes + image[0])

    def _depth(self) -> Iterator[Message]:
        seen, ranger = self._state.seen, self._state.ranger
        frame = seen.moment.seen.frame if seen and seen.moment.seen else None
        if frame is None or ranger is None or not self._is_new("depth", frame):
            return
        codes = pictures.depth(frame, ranger)
        height, width = codes.shape
        camera = ranger.camera
        shape = camera.width / (camera.height * camera.rows_joined)
        values = {"width": width, "height": height, "shape": shape}
        yield Message("depth", values, packed(codes))

    def _local(self) -> Iterator[Message]:
        seen = self._state.seen
        if seen is None or not self._is_new("local", seen):
            return
        settings = self._state.settings
        grid = pictures.local_map(seen.window, settings)
        full = 1 if settings.per_scan else settings.window
        yield _cells("local", grid, {"count": len(seen.window), "full": full})

    def _map(self) -> Iterator[Message]:
        snapshot = self._state.snapshot
        if snapshot is None or not self._is_new("map", snapshot):
            return
        values = {"maps": snapshot.local_maps, "places": snapshot.places}
        yield _cells("map", snapshot.grid, values)
        path = pictures.thinned(snapshot.trajectory.poses)
        yield Message("path", {}, path.tobytes())
        yield Message("particles", {}, snapshot.particles.astype(np.float32).tobytes())

    def _pose(self) -> Iterator[Message]:
        state = self._state
        if state.moment is None or state.run is None:
            return
        now, snapshot = (state.moment, state.phase), state.snapshot
        if self._sent.get("pose") == now:
            return
        self._sent["pose"] = now
        pose, known = state.moment[0].pose, len(snapshot.trajectory) if snapshot else 0
        if state.phase == ENDED and snapshot is not None and known:
            pose = snapshot.trajectory.poses[-1]
        tail = np.array(state.run.mapper.online[known:]).reshape(-1, 3)
        values = {"pose": [round(float(v), 4) for v in pose]}
        yield Message("pose", values, pictures.thinned(tail).tobytes())

    def _is_new(self, topic: str, what: object) -> bool:
        """Whether it is another object than was sent last; then it counts as sent."""
        new = self._sent.get(topic) is not what
        self._sent[topic] = what
        return new


def _cells(topic: str, grid: OccupancyGrid, values: dict[str, Any]) -> Message:
    codes, cell = pictures.cells(grid)
    height, width = codes.shape
    values |= {"width": width, "height": height, "origin": list(grid.origin), "cell": cell}
    return Message(topic, values, packed(codes))
