"""What lies beside the images of a recording: the rig file, and what it was made with.

The rig file is a copy of the one it was made with, marked at its end. One that was cut short can
still be valid YAML with another meaning (pitch 12.5 -> 1): the copy counts only with YAML's mark of
a document's end.
"""

from __future__ import annotations

import json
from pathlib import Path

from calibration.rig import RigError, StereoRig, load_rig
from calibration.yamlfile import YamlFileError, read_text

RIG_FILE = "rig.yaml"
META_FILE = "meta.json"
END = "\n...\n"


def marked(text: str) -> str:
    """The text of a rig file, to be written into a recording."""
    return text.rstrip() + END


def load_recorded_rig(path: Path) -> StereoRig:
    """The rig in a recording.

    Raises:
        RigError: cut short, not calibrated, or wrong.
    """
    try:
        whole = read_text(path).endswith(END)
    except YamlFileError as error:
        raise RigError(str(error)) from None
    if not whole:
        raise RigError(f"{path}: cut short (no '...' at its end)")
    return load_rig(path)


def mapped_cell(path: Path) -> float | None:
    """Side of the cells [m] of the map that was made meanwhile, of a recording's META_FILE; None:
    none was, or it does not say."""
    try:
        cell = json.loads(path.read_bytes())["cell"]
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return float(cell) if isinstance(cell, int | float) and 0.0 < cell < float("inf") else None
