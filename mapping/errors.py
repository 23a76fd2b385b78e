"""The error of this stage that a user can mend."""

from __future__ import annotations


class MappingError(ValueError):
    """One line with the remedy."""
