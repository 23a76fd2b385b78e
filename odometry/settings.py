"""Settings of the odometry stage: how far its increments are to be doubted."""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

NonNegative = Annotated[float, Meta(ge=0.0)]


class OdometrySettings(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """`noise` and `bias` spoil poses taken as odometry; the others are wheel odometry's doubt.

    Wheel odometry, from encoders or in a scan log, errs as a random walk: a standard deviation s
    per square root of a metre is s after 1 m and 2 s after 4 m. The doubt that comes from the
    resolution of the encoders follows from their ticks and needs no setting.
    """

    noise: Annotated[
        tuple[NonNegative, NonNegative],
        Meta(
            description="random error put on poses taken as odometry (motion 'poses' only): "
            "standard deviation of both coordinates as a fraction of the step's length, and of "
            "the heading in each step",
            extra={"unit": "[fraction, deg a step]"},
        ),
    ] = (0.0, 0.0)
    bias: Annotated[
        float,
        Meta(
            description="constant turn added to each step of poses taken as odometry "
            "(motion 'poses' only); the stated covariance does not know it",
            extra={"unit": "deg a step"},
        ),
    ] = 0.0
    along: Annotated[
        float,
        Meta(
            description="wheel odometry: standard deviation along the path after one metre",
            extra={"unit": "m/sqrt(m)"},
            ge=0.0,
        ),
    ] = 0.03
    across: Annotated[
        float,
        Meta(
            description="wheel odometry: standard deviation across the path after one metre "
            "(side slip, beside what the heading's error causes)",
            extra={"unit": "m/sqrt(m)"},
            ge=0.0,
        ),
    ] = 0.01
    # 0.67 deg of random error, and 0.2 % of one wheel's radius at 0.3 m of track: 0.38 deg a metre.
    heading: Annotated[
        float,
        Meta(
            description="wheel odometry: standard deviation of the heading after one metre",
            extra={"unit": "deg/sqrt(m)"},
            ge=0.0,
        ),
    ] = 1.0
    turn: Annotated[
        float,
        Meta(
            description="wheel odometry: standard deviation of the heading after one radian of "
            "turning",
            extra={"unit": "deg/sqrt(rad)"},
            ge=0.0,
        ),
    ] = 1.0
    max_speed: Annotated[
        float,
        Meta(
            description="wheel odometry: no wheel turns faster; what counters say beyond one and "
            "a half times this is a glitch or a restart of the board",
            extra={"unit": "m/s"},
            gt=0.0,
        ),
    ] = 1.5
