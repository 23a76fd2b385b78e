"""RunPage: a run that goes on, as a page; what its viewers may ask for."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path

from pipeline.places import Place
from pipeline.web.hub import RefusedError
from pipeline.web.messages import Message
from pipeline.web.run_news import RunNews
from pipeline.web.run_state import FINISHING, MAPPING, WAITING, RunState

LONGEST_NAME = 40


class RunPage:
    """name: of the run; output: where its map is saved, if it is; stop: set to end it.

    state: the watcher to give to the run.
    """

    index = "live.html"

    def __init__(self, name: str, output: Path | None, stop: threading.Event) -> None:
        self.state = RunState()
        self._output = output
        self._stop = stop
        self._news = RunNews(self.state, name, output)
        self._commands: dict[str, Callable[[str], str]] = {
            "save": self._save,
            "mark": self._mark,
            "stop": self._end,
        }

    def news(self) -> Iterator[Message]:
        """What changed since the last call."""
        return iter(self._news)

    def command(self, name: str, value: str) -> str:
        """save, mark (value: the name), stop."""
        if name not in self._commands:
            raise RefusedError(f"cannot {name}")
        return self._commands[name](value)

    def report(self) -> bytes | None:
        """None: it is among the results."""
        return None

    def _save(self, _value: str) -> str:
        if self._output is None:
            raise RefusedError("nothing is kept of this replay: give it -o OUT")
        if self.state.phase != MAPPING:
            raise RefusedError("there is no map yet, or it is finished and saved")
        self.state.want_map(tell=True)
        return "saving the map ..."

    def _mark(self, value: str) -> str:
        name = " ".join(value.split())
        if not name or len(name) > LONGEST_NAME or not name.isprintable():
            raise RefusedError(f"give a name of 1 to {LONGEST_NAME} letters")
        state = self.state
        if state.run is None or state.phase != MAPPING:
            raise RefusedError("the robot is nowhere yet, or its run is over")
        others = [place for place in state.run.places if place.name != name]
        # Exchanged whole: the thread that maps may be reading it.
        state.run.places = [*others, Place(name, len(state.run.mapper.stamps) - 1)]
        state.want_map(tell=False)
        state.tell(f"place marked: {name}")
        return f"'{name}' is where the robot is now"

    def _end(self, _value: str) -> str:
        if self.state.phase in (WAITING, MAPPING):
            self.state.phase = FINISHING
        self._stop.set()
        return "stopping: the map is being finished ..."
