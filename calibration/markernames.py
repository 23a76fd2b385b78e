"""The dictionaries of square markers that OpenCV knows, by the names used here."""

from __future__ import annotations

from calibration.errors import CalibrationError

# name -> how many markers. A smaller one of a family holds the first markers of the larger ones.
MARKERS_IN = {
    **{f"{n}x{n}_{size}": size for n in (4, 5, 6, 7) for size in (50, 100, 250, 1000)},
    "aruco_original": 1024,
    "aruco_mip_36h12": 250,
    "apriltag_16h5": 30,
    "apriltag_25h9": 35,
    "apriltag_36h10": 2320,
    "apriltag_36h11": 587,
}


def dictionary_name(text: str) -> str:
    """The dictionary written as `4x4_50` or as OpenCV's `DICT_4X4_50`.

    Raises:
        CalibrationError: there is none of this name.
    """
    name = text.strip().lower().removeprefix("dict_")
    if name not in MARKERS_IN:
        raise CalibrationError(
            f"--dictionary {text!r}: unknown: give one of {', '.join(MARKERS_IN)}"
        )
    return name


def smallest_dictionaries(markers: int) -> list[str]:
    """Of every family the smallest dictionary with that many markers, the commonest first.

    A small dictionary is read with more tolerance to errors than a large one.
    """
    families: dict[str, str] = {}
    for name, size in MARKERS_IN.items():
        family = name.rpartition("_")[0] if name[0].isdigit() else name
        if size >= markers:
            families.setdefault(family, name)
    return list(families.values())
