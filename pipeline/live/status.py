"""The status line of a live run or a recording: rates, queues, health, what is wrong."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from mapping.mapper import HierarchicalMapper

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
        self._before = {"pairs": 0, "readings": 0, "lost": 0, "skipped": 0}
        self.rates = dict.fromkeys(self._before, 0.0)

    def measure(self, seconds: float) -> None:
        """Take the rates since the last call, `seconds` ago."""
        encoders = self._session.encoders
        now = {
            "pairs": self._session.camera.report().pairs,
            "readings": encoders.report().get("readings", 0) if encoders else 0,
            "lost": self._session.recorder.counts["dropped"],
            "skipped": self._mapper.skipped if self._mapper else 0,
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

    def figures(self) -> dict[str, str]:
        """What the line says, by name."""
        found = {"pairs a second": f"{self.rates['pairs']:.1f}"}
        if self._session.encoders is not None:
            found["wheel readings a second"] = f"{self.rates['readings']:.0f}"
        found["pairs recorded"] = str(self._session.recorder.counts["pairs"])
        if self._mapper is not None:
            found["pairs waiting"] = str(self._mapper.backlog)
            found |= mapping_figures(self._mapper.mapper)
        return found

    def warnings(self) -> list[str]:
        """What the user should look after."""
        return [text for text in self.checks().values() if text]

    def checks(self) -> dict[str, str]:
        """What is looked at, and what is wrong with it; empty: nothing."""
        camera, encoders = self._session.camera, self._session.encoders
        silent, skew = camera.silence(), camera.report().skew_ms[1]
        found = {
            "cameras": f"no image for {silent:.0f} s" if silent > SILENT else "",
            "left and right in step": f"left and right {skew:.0f} ms apart"
            if skew > SKEW_MS
            else "",
        }
        if encoders is not None:
            found["wheels"] = "" if self.rates["readings"] else "no reading of the encoders"
            if not encoders.connected:
                found["wheels"] = "encoders lost"
        found["disk keeps up"] = (
            "pairs are lost: the disk is too slow" if self.rates["lost"] else ""
        )
        if self._mapper is not None:
            late = self.rates["skipped"] > 0
            found["mapping keeps up"] = "mapping is late: pairs are skipped" if late else ""
            found |= mapping_checks(self._mapper.mapper)
        return found


def mapping_figures(mapper: HierarchicalMapper) -> dict[str, str]:
    """How the map grows, by name."""
    health = mapper.filter.health
    found = {"local maps": str(len(health))}
    if health:
        share = health[-1].n_eff / mapper.settings.particles
        found |= {
            "particles that agree (N_eff)": f"{share:.0%}",
            "columns that answered": f"{health[-1].answered:.0%}",
        }
    return found


def mapping_checks(mapper: HierarchicalMapper) -> dict[str, str]:
    """What is wrong with the latest local map, as `Status.checks`."""
    health = mapper.filter.health
    few = bool(health) and health[-1].answered < FEW_COLUMNS
    lost = bool(health) and health[-1].n_eff < FEW_PARTICLES * mapper.settings.particles
    return {
        "enough is seen": "few columns answer: more light or texture" if few else "",
        "particles agree": "few particles agree" if lost else "",
    }
