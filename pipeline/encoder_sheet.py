"""Encoder parameters as they stand in a rig file and in `odom0/sensor.yaml`."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from odometry.encoders import EncoderParameters


def encoder_sheet(parameters: EncoderParameters) -> dict[str, Any]:
    """Field -> value; what need not be said is left out."""
    fields = {**asdict(parameters), "reversed": list(parameters.reversed)}
    return {key: value for key, value in fields.items() if value is not None}
