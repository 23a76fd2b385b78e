"""The verdict: one word for the held-out rectified row error."""

from __future__ import annotations

# Word, and the held-out row error [px RMS] below which it holds.
LIMITS = (("excellent", 0.15), ("good", 0.3), ("usable", 0.5))
REDO = "redo"

# What the word means for the person who reads it.
MEANING = {
    "excellent": "rows agree far better than stereo matching can tell",
    "good": "stereo matching will hardly notice what is left",
    "usable": "stereo matching works, with some more holes and false matches",
    REDO: "rows differ so much that stereo matching will fail in places",
}


def verdict(heldout_row_rms: float) -> str:
    """The word for a held-out row error [px RMS]."""
    return next((word for word, limit in LIMITS if heldout_row_rms < limit), REDO)
