"""The settings that the experiments compare: the paper's, and ours.

Both are lists of `--set` values: `beemap map LOG` with the same list does the same.
"""

from __future__ import annotations

from dataclasses import dataclass

# The two methods. The previous one is ordinary FastSLAM: every single scan feeds the filter, and
# the particles are drawn from the motion alone.
HIERARCHICAL = ("mapping.method=hierarchical",)
PREVIOUS = ("mapping.method=per-scan", "mapping.proposal=motion")
METHODS = (HIERARCHICAL, PREVIOUS)

# Figures and tables name them so.
METHOD_NAMES = {"hierarchical": "hierarchical", "per-scan": "previous method"}

# eq (11) is eq (12) at this value.
ALPHA = 5.0 / 3.0
# In this world dead reckoning alone is lost.
WORLD = "flat"


@dataclass(frozen=True)
class Preset:
    """name: in rows and tables; settings: as of `--set`; sigma: whether a range's doubt is used,
    else every hit is a point, as in the paper."""

    name: str
    settings: tuple[str, ...]
    sigma: bool


# Every value that the paper or the readings of it give, so that a change of our defaults does not
# change what is called the paper's. Its one departure is match_tolerance, 0 as printed: 1 is
# fairer to both methods; `beemap experiment readings` shows both.
PAPER = Preset(
    "paper",
    (
        "mapping.cell=0.05",
        "mapping.spacing=0",  # every position is an observation
        "mapping.window=10",
        "mapping.hit=0.54",
        "mapping.false_hit=0.1",
        "mapping.occupied=0.7",
        "mapping.free=0.2",
        "mapping.particles=100",
        "mapping.match_weight=50",
        "mapping.match_tolerance=1",
        "mapping.min_overlap=50",
        "mapping.resample_below=0.5",
        "mapping.ego_motion=raw",
        "mapping.smoothing=false",
    ),
    sigma=False,
)

# The defaults of beemap (scan-matched ego-motion, a milder k), with what a simulated log says of
# itself: every position counts, errors are independent from beam to beam, hits are points.
OURS = Preset(
    "ours",
    ("mapping.spacing=0", "mapping.correlated=1", "mapping.spread=false"),
    sigma=True,
)
