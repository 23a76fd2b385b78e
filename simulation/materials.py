"""The materials a scene may name; the place in the tuple is the number the kernels use."""

from __future__ import annotations

from typing import NamedTuple

MATERIALS = (
    "plaster",
    "carpet",
    "wood",
    "laminate",
    "fabric",
    "metal",
    "books",
    "poster",
    "door",
    "cabinet",
    "skirting",
    "ceiling",
    "lamp",
    "cardboard",
    "leaves",
    "whiteboard",
    "screen",
    "drawers",
    "white",
    "tiles",
    "blinds",
    "vinyl",
    "lino",
    "concrete",
    "parquet",
    "brick",
    "rug",
    "matte_black",
    "gloss_black",
    "aluminium",
    "plain_door",
    "notice",
    "radiator",
    "extinguisher",
    "sign",
    "crate",
    "tools",
    "shirt",
    "skin",
    "glass",
    "clear_glass",
    "frosted_glass",
)

# Panes: one sheet each, printed as their texture says and clear elsewhere.
PANES = ("glass", "clear_glass", "frosted_glass")


class Gloss(NamedTuple):
    """Mirror-like share of the light: `facing` looked at straight, up to `grazing` by Schlick
    (1994); `blur`: spread of the mirrored direction [rad]."""

    facing: float
    grazing: float
    blur: float


# A smooth surface has grazing 1. Wax and wear scatter much of it, so floors stay below. Both
# surfaces of a pane reflect 4 % each.
GLOSS = {
    "vinyl": Gloss(0.04, 0.55, 0.012),
    "lino": Gloss(0.03, 0.22, 0.012),
    "parquet": Gloss(0.03, 0.30, 0.012),
    "tiles": Gloss(0.04, 0.60, 0.01),
    "gloss_black": Gloss(0.04, 0.90, 0.003),
    "glass": Gloss(0.08, 1.0, 0.0),
    "clear_glass": Gloss(0.08, 1.0, 0.0),
    "frosted_glass": Gloss(0.08, 1.0, 0.0),
}
