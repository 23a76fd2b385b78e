"""What to do after a calibration: its advice, with the command where all is well."""

from __future__ import annotations

from pathlib import Path

from calibration.advice import NOTHING
from calibration.calibrate import CalibrationResult


def next_steps(result: CalibrationResult, output: Path) -> list[str]:
    """The most useful first; output: the rig file."""
    first, *others = result.advice
    if first != NOTHING:
        return result.advice
    if result.rig.mount is None:
        command = f"beemap calibrate mount RECORDING --rig {output}"
    else:
        command = f"beemap map RECORDING -o OUT --rig {output}"
    return [f"{first}: {command}", *others]
