"""Text files as people and other programs leave them: byte order marks, any line ends."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from calibration.yamlfile import YamlFileError, read_yaml
from pipeline.errors import InputError


def read_lines(path: Path) -> list[str]:
    """The lines of a text file; a byte that is no text garbles its own line, not the file.

    Raises InputError when the file is missing or cannot be read.
    """
    try:
        # utf-8-sig: spreadsheets put a byte order mark before the first line.
        return path.read_text(encoding="utf-8-sig", errors="replace").splitlines()
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror or error})") from None


def ends_whole(path: Path) -> bool:
    """Whether a text file ends with the end of a line; a writer that was cut off leaves less."""
    with path.open("rb") as file:
        file.seek(0, 2)
        file.seek(max(0, file.tell() - 1))
        return file.read() == b"\n"


def read_fields(path: Path) -> dict[str, Any]:
    """The named fields of a YAML file.

    Raises InputError when it cannot be read or holds something else.
    """
    try:
        data = read_yaml(path)
    except YamlFileError as error:
        raise InputError(str(error)) from None
    if not isinstance(data, dict):
        raise InputError(f"{path}: expected 'name: value' lines, got {type(data).__name__}")
    return data
