"""The error of the calibration stage."""

from __future__ import annotations


class CalibrationError(ValueError):
    """Images or options that give no calibration; one line with the cause and the remedy."""
