"""The status line of a live run or a recording: rates, queues, health, what is wrong."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pipeline.live.capture import Session
    from pipeline.live.mapping_thread import LiveMapper

SILENT = 1.0  # s without an image or a reading that are worth a warning
SKEW_MS = 5.0
FEW_COLUMNS = 0.3
FEW_PARTICLES = 0.05


class Status:
    """Figures of a session, measured now and then; mapper: None when it is only recorded."""

    def __init__(self, session: Session, mapper: LiveMapper | None = None) -> None:
        self._session = session
        self._mapper = mapper
        self._before = {"pairs": 0, "readings": 0}
        self.rates = {"pairs": 0.0, "readings": 0.0}

    def measure(self, seconds: float) -> None:
        """Take the rates since the last call, `seconds` ago."""
        encoders = self._session.encoders
        now = {
            "pairs": self._session.camera.report().pairs,
            "readings": encoders.report().get("readings", 0) if encoders else 0,
        }
        self.rates = {key: (now[key] - self._before[key]) / seconds for key in now}
        self._before = now

    def line(self) -> str:
        """All in one line."""
        recorder = self._session.recorder
        parts = [f"{self.rates['pairs']:.1f} pairs/s"]
        if self._session.encoders is not None:
            parts.append(f"{self.rates['readings']:.0f} readings/s")
        lost = f" ({recorder.counts['dropped']} lost)" if recorder.counts["dropped"] else ""
        parts.append(f"{recorder.counts['pairs']} recorded{lost}")
        if self._mapper is not None:
            parts += self._mapping(self._mapper)
        warnings = self.warnings()
        return ", ".join(parts) + (f" | {'; '.join(warnings)}" if warnings else "")

    def _mapping(self, mapper: LiveMapper) -> list[str]:
        health = mapper.mapper.filter.health
        parts = [f"queue {mapper.backlog}", f"{mapper.skipped} skipped", f"{len(health)} maps"]
        if health:
            share = health[-1].n_eff / mapper.mapper.settings.particles
            parts += [f"N_eff {share:.0%}", f"columns {health[-1].answered:.0%}"]
        if mapper.mapper.online:
            x, y, theta = mapper.mapper.online[-1]
            parts.append(f"at {x:.2f} {y:.2f} m {math.degrees(theta):.0f} deg")
        return parts

    def warnings(self) -> list[str]:
        """What the user should look after."""
        found = []
        camera, encoders = self._session.camera, self._session.encoders
        if (silent := camera.silence()) > SILENT:
            found.append(f"no image for {silent:.0f} s")
        if encoders is not None and not encoders.connected:
            found.append("encoders lost")
        elif encoders is not None and not self.rates["readings"]:
            found.append("no reading of the encoders")
        if (skew := camera.report().skew_ms[1]) > SKEW_MS:
            found.append(f"left and right {skew:.0f} ms apart")
        health = self._mapper.mapper.filter.health if self._mapper else []
        if health and health[-1].answered < FEW_COLUMNS:
            found.append("few columns answer: more light or texture")
        particles = self._mapper.mapper.settings.particles if self._mapper else 0
        if health and health[-1].n_eff < FEW_PARTICLES * particles:
            found.append("few particles agree")
        return found
