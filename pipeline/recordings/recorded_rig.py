"""The rig file that lies in a recording: a copy of the one it was made with, marked at its end.

A rig file that was cut short can still be valid YAML with another meaning (pitch 12.5 -> 1):
the copy counts only with YAML's mark of a document's end.
"""

from __future__ import annotations

from pathlib import Path

from calibration.rig import RigError, StereoRig, load_rig
from calibration.yamlfile import YamlFileError, read_text

RIG_FILE = "rig.yaml"
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
