"""What the user chose, and the runs that follow from it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from mapping.settings import MappingSettings
from pipeline.experiments.presets import ALPHA, Preset
from pipeline.experiments.spec import RunSpec, place
from pipeline.settings import load_settings
from pipeline.tasks.runner import Workers
from simulation.paper import PaperSettings, positions_on

# The paper's; a shorter route is driven to its end.
POSITIONS, SPACING = PaperSettings.positions, PaperSettings.spacing


@dataclass(frozen=True)
class Options:
    """seeds: runs of each kind, from `first_seed` on; settings: `--set` values of the user, which
    win over the presets'; workers: who does the runs."""

    folder: Path
    seeds: int
    first_seed: int
    workers: Workers
    world: str
    route: str | None = None
    settings: tuple[str, ...] = ()
    quiet: bool = False

    @property
    def place(self) -> str:
        """The world's name in titles."""
        return Path(self.world).stem

    def seed_range(self, most: int | None = None) -> range:
        """The seeds of a kind of run that needs at most so many."""
        seeds = self.seeds if most is None else min(self.seeds, most)
        return range(self.first_seed, self.first_seed + seeds)

    def spec(
        self, preset: Preset, seed: int, *settings: str, varied: str = "", **simulated: Any
    ) -> RunSpec:
        """A run with the preset, then `settings`, then the user's; simulated: fields of RunSpec.

        Raises:
            InputError: an unknown or ill-typed setting.
            WorldError: world or route cannot be used.
        """
        chosen = {
            "world": self.world,
            "route": self.route,
            "alpha": ALPHA,
            "sigma": preset.sigma,
            **simulated,
        }
        room = positions_on(place(chosen["world"], chosen["route"])[1], SPACING)
        return RunSpec(
            preset=preset.name,
            varied=varied,
            seed=seed,
            mapping=mapping_settings((*preset.settings, *settings, *self.settings)),
            **{"positions": min(POSITIONS, room), **chosen},
        )


@cache
def mapping_settings(settings: tuple[str, ...]) -> MappingSettings:
    """Defaults changed by `--set` values.

    Raises:
        InputError: an unknown or ill-typed setting.
    """
    return load_settings(None, settings).mapping
