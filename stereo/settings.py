"""Settings of the stereo stage."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec


def _meta(description: str, unit: str, **limits: Any) -> msgspec.Meta:
    return msgspec.Meta(description=description, extra={"unit": unit}, **limits)


class StereoSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How a stereo pair becomes a range scan."""

    disparities: Annotated[
        Annotated[int, msgspec.Meta(ge=16)] | None,
        _meta(
            "disparities searched, a multiple of 16; null: from the rig, near obstacles kept", "px"
        ),
    ] = None
    matcher: Annotated[
        Literal["3way", "sgbm", "hh", "hh4", "bm"],
        _meta("OpenCV's matcher: semi-global in 3, 5, 8 or 4 directions, or plain blocks", ""),
    ] = "3way"
    rows_joined: Annotated[
        Annotated[int, msgspec.Meta(ge=1, le=2)] | None,
        _meta(
            "image rows averaged into one before matching: half the time and fewer false matches; "
            "null: 2 where the image is fine enough",
            "rows",
        ),
    ] = None
    block: Annotated[int, _meta("side of the matched block, odd", "px", ge=1, le=11)] = 5
    uniqueness: Annotated[
        int, _meta("the best match must win by this margin", "%", ge=0, le=100)
    ] = 10
    speckle: Annotated[
        int, _meta("islands of disparity smaller than this are false matches", "pixels", ge=0)
    ] = 60
    support: Annotated[
        int,
        _meta(
            "pixels that must agree on the nearest obstacle; 1: the paper's nearest", "pixels", ge=1
        ),
    ] = 6
    texture: Annotated[
        float,
        _meta(
            "gradients are evidence beyond so many times the noise of the image; elsewhere the "
            "matcher only guesses",
            "",
            gt=0,
        ),
    ] = 0.8
    height_min: Annotated[float, _meta("lower things are floor", "m")] = 0.10
    height_max: Annotated[float, _meta("higher things do not stop the robot", "m")] = 1.20
    tilt_sigma: Annotated[
        float, _meta("doubt of the mount's pitch; lifts height_min with distance", "deg", ge=0)
    ] = 0.5
    noise: Annotated[float, _meta("standard deviation of a matched disparity", "px", gt=0)] = 0.25
