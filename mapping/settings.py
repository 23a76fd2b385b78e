"""Settings of the two-stage mapper. Defaults are the paper's unless the meaning says why not."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec


def _meta(description: str, unit: str, **limits: Any) -> msgspec.Meta:
    return msgspec.Meta(description=description, extra={"unit": unit}, **limits)


class MappingSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How scans and motion become a map and a path."""

    cell: Annotated[
        float,
        _meta(
            "side of a map cell; null: 0.05, larger where a camera that goes far from pair to pair "
            "would see too little",
            "m",
            gt=0,
        ),
    ] = 0.05
    footprint: Annotated[
        Annotated[float, msgspec.Meta(ge=0)] | None,
        _meta(
            "radius of the robot's body about the middle of its axle: where it has been is free; "
            "null: half the track of its wheels, 0 (the cells under its path) without wheels",
            "m",
        ),
    ] = None
    max_range: Annotated[
        Annotated[float, msgspec.Meta(gt=0)] | None,
        _meta("farthest range used; null: as far as the rig can tell", "m"),
    ] = None
    spacing: Annotated[float, _meta("an observation is due after this travel", "m", ge=0)] = 0.17
    spacing_angle: Annotated[float, _meta("an observation is due after this turn", "deg", ge=0)] = (
        10.0
    )
    method: Annotated[
        Literal["hierarchical", "per-scan"],
        _meta(
            "hierarchical: local maps of `window` observations feed the filter; per-scan: every "
            "single observation does",
            "",
        ),
    ] = "hierarchical"
    proposal: Annotated[
        Literal["motion", "matched"] | None,
        _meta(
            "particles are drawn from the motion alone, or about the best match of the hits to "
            "each particle's own map; null: matched for per-scan, else motion",
            "",
        ),
    ] = None
    ego_motion: Annotated[
        Literal["matched", "raw"],
        _meta("matched: scans correct odometry before both stages; raw: the paper's", ""),
    ] = "matched"
    # SGBM compares blocks and passes disparities on along rows and diagonals.
    correlated: Annotated[
        float,
        _meta("neighbouring ranges share their errors over this angle", "deg", gt=0),
    ] = 3.0
    spread: Annotated[
        bool,
        _meta(
            "stage 1 spreads every hit over the doubt of its range; false: hits are points, as in "
            "the paper (better where errors are independent from beam to beam)",
            "",
        ),
    ] = True
    window: Annotated[int, _meta("observations fused into a local map", "", ge=1)] = 10
    hit: Annotated[
        float, _meta("P(O|E): an obstacle that is there is observed", "", gt=0, lt=1)
    ] = 0.54
    false_hit: Annotated[
        float, _meta("P(O|notE): an obstacle is observed where none is", "", gt=0, lt=1)
    ] = 0.1
    occupied: Annotated[
        float, _meta("a cell above this probability is an obstacle", "", gt=0.5, lt=1)
    ] = 0.7
    free: Annotated[float, _meta("a cell below this probability is free", "", gt=0, lt=0.5)] = 0.2
    particles: Annotated[int, _meta("particles N", "", ge=1)] = 300
    match_tolerance: Annotated[
        int,
        _meta("an obstacle cell matches within this; the paper: 0", "cells", ge=0, le=5),
    ] = 1
    # Ten looks at the same wall are not ten independent ones: with 50 the filter is over-confident
    # and loses good particles to chance.
    match_weight: Annotated[float, _meta("k of eq (8); the paper: 50", "", ge=0)] = 20.0
    min_overlap: Annotated[
        int,
        _meta("with fewer global obstacle cells in view: not judged", "cells", ge=0),
    ] = 50
    resample_below: Annotated[
        float, _meta("resample when N_eff falls below this share of N", "", ge=0, le=1)
    ] = 0.5

    smoothing: Annotated[
        bool,
        _meta(
            "at the end all local maps are aligned to one another and the map is drawn anew; "
            "false: the best particle's path and map stay, as in the paper",
            "",
        ),
    ] = True

    @property
    def per_scan(self) -> bool:
        """Whether single observations feed the filter."""
        return self.method == "per-scan"

    @property
    def matched_proposal(self) -> bool:
        """Whether the particles are drawn about their best match."""
        return self.per_scan if self.proposal is None else self.proposal == "matched"
