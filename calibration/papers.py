"""Sheets of paper that boards are printed on."""

# Width and height of an upright sheet [mm], the smallest first
PAPERS = {
    "letter": (215.9, 279.4),
    "a4": (210.0, 297.0),
    "a3": (297.0, 420.0),
    "a2": (420.0, 594.0),
    "a1": (594.0, 841.0),
    "a0": (841.0, 1189.0),
}
