"""The error a user can mend: one line, exit code 2, no traceback."""

from __future__ import annotations


class InputError(ValueError):
    """Names the file, the field, the value and the remedy in one line."""
