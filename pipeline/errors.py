"""The error a user can mend: one line, exit code 2, no traceback."""

from __future__ import annotations

# An error class of one of these packages is a message to the user; any other error is a bug.
OURS = {"calibration", "stereo", "odometry", "mapping", "pipeline", "simulation"}


class InputError(ValueError):
    """Names the file, the field, the value and the remedy in one line."""


def one_line(message: str) -> str:
    """The message without line ends."""
    return " ".join(message.split())


def for_user(error: Exception) -> str | None:
    """What the user must know of an error that is his to mend; None: it is a bug."""
    if isinstance(error, MemoryError):
        return "out of memory: give larger mapping.cell, fewer particles"
    if isinstance(error, OSError):
        # A file that the system refuses is the user's to mend; without a name it is a bug.
        return None if error.filename is None else f"{error.filename}: {error.strerror}"
    if type(error).__module__.partition(".")[0] in OURS:
        return one_line(str(error))
    return None
