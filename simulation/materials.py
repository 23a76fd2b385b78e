"""The materials a scene may name; the place in the tuple is the number the kernels use."""

from __future__ import annotations

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
)
