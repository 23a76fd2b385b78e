"""Origin: where a run came from and where its results go, for the commands a report names."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.recordings.base import RecordedPair

NEW_RIG = "rig.yaml"


@dataclass(frozen=True)
class Origin:
    """output: the result folder; recording: what was mapped, or recorded meanwhile; arguments: of
    `beemap map`, which would open it again as it was opened; rig: the file given, None: the
    recording's own; pairs: the recording's, opened when they are asked for."""

    output: Path
    recording: Path
    arguments: Sequence[str]
    rig: Path | None = None
    pairs: Callable[[], Sequence[RecordedPair]] = tuple

    @staticmethod
    def unknown(output: Path) -> Origin:
        """Of a run that was made by hand."""
        return Origin(output, Path("RECORDING"), ["RECORDING"])

    def fill(self, command: str) -> str:
        """A command with the names in braces replaced: {recording}, {rate_option}: its frame rate,
        with a blank before it, if one was given, {output}, {rig}: a rig file or what holds one,
        {rig_option}: with a blank before it, {new_rig}: a rig file to be written, {map}: this run
        again into another folder."""
        again = [
            *self.arguments, "--settings", str(self.output / "settings.yaml"),
            "-o", f"{self.output}-again",
        ]  # fmt: skip
        rig = "" if self.rig is None else " " + shlex.join(["--rig", str(self.rig)])
        at = self.arguments.index("--fps") if "--fps" in self.arguments else len(self.arguments)
        rate = "".join(f" {word}" for word in self.arguments[at : at + 2])
        return command.format(
            recording=shlex.quote(str(self.recording)),
            rate_option=rate,
            output=shlex.quote(str(self.output)),
            rig=shlex.quote(str(self.rig or self.recording)),
            rig_option=rig,
            new_rig=shlex.quote(str(self.rig or NEW_RIG)),
            map=shlex.join(["beemap", "map", *again]),
        )
