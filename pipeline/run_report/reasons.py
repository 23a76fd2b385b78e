"""What went wrong in a pair, in words."""

from __future__ import annotations

import numpy as np

from pipeline.frontend import UNREADABLE
from pipeline.health.filter_findings import FilterFigures
from pipeline.health.image_findings import REMEDIES
from pipeline.worst_pairs import FEW_RANGES, UNLIKE_MAP, Suspect

# Grey levels of 255, and a share of the pixels, that make a cause likely.
DARK, GLARE, GLARE_SHARE, FLAT = 40.0, 250, 0.2, 12.0


def reason(
    suspect: Suspect, figures: FilterFigures | None, sight: str, grey: np.ndarray | None
) -> tuple[str, str]:
    """In a few words, and in a sentence; grey: its left image, where it can be seen."""
    if suspect.kind == FEW_RANGES:
        usual = f" (on average: {figures.answered:.0%})" if figures else ""
        heading = f"{suspect.share:.0%} of the {sight} answered{usual}"
        return heading, "" if grey is None else _cause(grey, suspect.share)
    if suspect.kind == UNLIKE_MAP:
        usual = f" (usual: {figures.matched:.0%})" if figures and figures.matched else ""
        return (
            f"{suspect.share:.0%} of the map in view was seen again{usual}",
            "Around here the map holds obstacles that were not seen, or seen elsewhere: a pose is "
            "wrong, stereo is, or something moved."
            if suspect.share < 0.5
            else "The worst of the run, and no cause for worry.",
        )
    text = suspect.why if suspect.kind == UNREADABLE else REMEDIES.get(suspect.kind, suspect.why)
    return suspect.kind, f"{text[:1].upper()}{text[1:]}."


def _cause(grey: np.ndarray, answered: float) -> str:
    """Why columns may have no answer, by the look of the image."""
    if grey.mean() < DARK:
        return f"The image is dark: its mean grey is {grey.mean():.0f} of 255."
    if (share := float(np.mean(grey >= GLARE))) > GLARE_SHARE:
        return f"{share:.0%} of the image is overexposed."
    if grey.std() < FLAT:
        return "There is hardly any contrast in it."
    if answered > 0.8:
        return "The worst of the run, and no cause for worry."
    return "Black in the bar: a surface without texture, an edge alone, or something too near."
