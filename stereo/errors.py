"""The stereo stage's own error."""

from __future__ import annotations


class StereoError(ValueError):
    """Pairs that cannot be used at all; the message is one line with the remedy."""


class CameraError(StereoError):
    """A camera that cannot be opened, or was lost; one line with the remedy."""
