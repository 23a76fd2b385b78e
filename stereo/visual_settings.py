"""Settings of visual odometry."""

from __future__ import annotations

from typing import Annotated

import msgspec


class VisualSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a calibration leaves unknown of the motion, beside the images' noise, which is measured.

    Such errors are the same from one key frame to the next. They are as large as those of its
    rows, which are seen: the values are those of a rig whose rows differ by `rows`, and scaled by
    what is measured.
    """

    rows: Annotated[
        float,
        msgspec.Meta(
            description="visual odometry: root mean square of the difference of rows between the "
            "rectified images, noise left out, of a rig to which the next three apply",
            extra={"unit": "px"},
            gt=0.0,
        ),
    ] = 0.4
    along: Annotated[
        float,
        msgspec.Meta(
            description="visual odometry: standard deviation along the path that comes from the "
            "calibration (baseline, focal length, distortion), beside what is measured",
            extra={"unit": "m/m"},
            ge=0.0,
        ),
    ] = 0.003
    across: Annotated[
        float,
        msgspec.Meta(
            description="visual odometry: standard deviation of the direction of travel that comes "
            "from the calibration (yaw of the mount, principal point)",
            extra={"unit": "deg"},
            ge=0.0,
        ),
    ] = 0.2
    heading: Annotated[
        float,
        msgspec.Meta(
            description="visual odometry: standard deviation of the heading after one metre, or "
            "one radian, that comes from the calibration, beside what is measured",
            extra={"unit": "deg/m, deg/rad"},
            ge=0.0,
        ),
    ] = 0.03
