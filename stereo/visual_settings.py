"""Settings of visual odometry."""

from __future__ import annotations

from typing import Annotated

import msgspec


class VisualSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the images themselves do not tell of the motion's doubt: their noise is measured."""

    along: Annotated[
        float,
        msgspec.Meta(
            description="visual odometry: standard deviation along the path after one metre that "
            "comes from the calibration (baseline, focal length), beside what is measured",
            extra={"unit": "m/sqrt(m)"},
            ge=0.0,
        ),
    ] = 0.01
    heading: Annotated[
        float,
        msgspec.Meta(
            description="visual odometry: standard deviation of the heading after one metre, or "
            "one radian, that comes from the calibration, beside what is measured",
            extra={"unit": "deg/sqrt(m), deg/sqrt(rad)"},
            ge=0.0,
        ),
    ] = 0.1
