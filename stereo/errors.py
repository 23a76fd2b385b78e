"""The stereo stage's own error."""

from __future__ import annotations


class StereoError(ValueError):
    """Pairs that cannot be used at all; the message is one line with the remedy."""
