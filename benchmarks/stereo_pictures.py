"""Disparity on pictures with known truth (Middlebury 2001, 2003, 2014), beside OpenCV's matchers.

A pixel counts where the truth is known and its true match lies inside the other image; what has
no answer is told as density. OpenCV's own test counts otherwise, hence one more column: pixels
that both cameras see, BORDER px from the edge, those without an answer counted as wrong.
The pictures are not part of the project: BEEMAP_REAL_DATA names the folder that holds them.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from calibration.rig import CameraModel, Mount, StereoRig
from pipeline.experiments.report import markdown_table
from stereo.disparity import SUBPIXEL
from stereo.ranger import StereoRanger
from stereo.settings import StereoSettings

ROUNDS = 3
BORDER = 10
# name: (grey levels of the truth's image per pixel of disparity, disparities searched).
MIDDLEBURY = {"cones": (4, 64), "tsukuba": (16, 16), "venus": (8, 32), "bull": (8, 32)}
# Share of pixels off by more than 1 px in OpenCV's own test of SGBM, those without answer included.
OPENCV_TEST = {"cones": 0.141, "tsukuba": 0.044, "venus": 0.147, "bull": 0.079}
MODES = {
    "SGBM": cv2.STEREO_SGBM_MODE_SGBM,
    "3WAY": cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    "HH": cv2.STEREO_SGBM_MODE_HH,
    "HH4": cv2.STEREO_SGBM_MODE_HH4,
}
HEADER = (
    "matcher",
    "density",
    "off > 1 px",
    "off > 2 px",
    "median [px]",
    "wrong or none",
    "time [ms]",
)


@dataclass(frozen=True)
class Picture:
    """A rectified pair, grey uint8 (H, W), its disparity (H, W) px (NaN: unknown), how many
    disparities to search, and the focal length [px], baseline [m] and centre (x, y) [px]."""

    name: str
    left: np.ndarray
    right: np.ndarray
    truth: np.ndarray
    disparities: int
    f: float = 512.0
    baseline: float = 0.12
    centre: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        assert self.left.shape == self.right.shape == self.truth.shape

    @property
    def inside(self) -> np.ndarray:
        """Pixels (H, W) whose true match lies inside the other image."""
        return np.arange(self.truth.shape[1]) - self.truth >= 0.0

    @property
    def seen_by_both(self) -> np.ndarray:
        """Pixels (H, W) whose true match is not hidden behind something nearer."""
        nearest = np.full(self.truth.shape, -np.inf)
        rows, columns = np.nonzero(self.inside)
        d = self.truth[rows, columns]
        match = np.rint(columns - d).astype(int)
        np.maximum.at(nearest, (rows, match), d)
        seen = np.zeros(self.truth.shape, bool)
        seen[rows, columns] = d > nearest[rows, match] - 1.0
        return seen

    def rig(self) -> StereoRig:
        """Level, and so high that no floor is in view."""
        height, width = self.left.shape
        x, y = self.centre or ((width - 1) / 2.0, (height - 1) / 2.0)
        camera = CameraModel(self.f, self.f, x, y)
        return StereoRig(
            image_size=(width, height),
            left=camera,
            right=camera,
            R=np.eye(3),
            T=np.array([-self.baseline, 0.0, 0.0]),
            rectified=True,
            mount=Mount(height=50.0),
        )

    def ranger(self, **settings: object) -> StereoRanger:
        """The stage with its defaults, but for a height band that holds all rows."""
        every_row = {"height_min": 0.0, "height_max": 100.0, "tilt_sigma": 0.0}
        chosen = {"disparities": self.disparities, **every_row, **settings}
        return StereoRanger(self.rig(), StereoSettings(**chosen), max_range=1e3)


def real_data() -> Path | None:
    """Where the pictures lie."""
    folder = os.environ.get("BEEMAP_REAL_DATA")
    return Path(folder) / "stereo" if folder else None


def middlebury(folder: Path, name: str) -> Picture:
    """One of the pairs of 2001 and 2003."""
    scale, disparities = MIDDLEBURY[name]
    left, right, truth = (
        cv2.imread(str(folder / "middlebury" / name / f"{image}.png"), cv2.IMREAD_GRAYSCALE)
        for image in ("im2", "im6", "disp2")
    )
    assert left is not None
    assert right is not None
    assert truth is not None
    known = np.where(truth > 0, truth / scale, np.nan)
    return Picture(name, left, right, known, disparities)


def motorcycle(folder: Path) -> Picture:
    """Motorcycle of 2014 at a quarter of its size."""
    left, right = (
        cv2.imread(str(folder / "motorcycle" / f"motorcycle_{side}.png"), cv2.IMREAD_GRAYSCALE)
        for side in ("left", "right")
    )
    assert left is not None
    assert right is not None
    with np.load(folder / "motorcycle" / "motorcycle_disp.npz") as data:
        truth = data["arr_0"]
    known = np.where(np.isfinite(truth), truth, np.nan)
    return Picture("motorcycle", left, right, known, 96, 994.978, 0.193001, (311.193, 254.877))


def opencv_matcher(name: str, disparities: int) -> cv2.StereoMatcher:
    """OpenCV's matcher with the values of its documentation and samples; block 5, BM 15."""
    if name == "BM":
        matcher = cv2.StereoBM.create(disparities, 15)
        matcher.setUniquenessRatio(10)
        matcher.setDisp12MaxDiff(1)
    else:
        matcher = cv2.StereoSGBM.create(
            minDisparity=0,
            numDisparities=disparities,
            blockSize=5,
            P1=8 * 25,
            P2=32 * 25,
            disp12MaxDiff=1,
            uniquenessRatio=10,
            mode=MODES[name],
        )
    matcher.setSpeckleWindowSize(100)
    matcher.setSpeckleRange(1 if name != "BM" else 32)
    return matcher


def main() -> str:
    """Measure; the section as Markdown."""
    title = "## Disparity on real pictures: `python -m benchmarks.stereo_pictures`"
    folder = real_data()
    if folder is None:
        return f"{title}\n\nBEEMAP_REAL_DATA is not set: the pictures were not measured."
    cv2.setNumThreads(1)
    parts = [title]
    for picture in [*(middlebury(folder, name) for name in MIDDLEBURY), motorcycle(folder)]:
        parts += [f"### {picture.name}", _table(picture)]
    return "\n\n".join([*parts, LEGEND])


LEGEND = (
    "Grey pairs, one thread; time: least of three. density: share of the pixels with an answer, "
    "off: share of the answered ones, both where the true match lies inside the other image; "
    f"wrong or none: share of the pixels seen by both cameras, {BORDER} px from the edge, that are "
    "off by more than 1 px or have no answer, the count of OpenCV's own test of SGBM and its "
    "figure there (colour images). OpenCV's matchers: block 5, P1 8 and P2 32 times its area, "
    "uniqueness 10, speckles of 100 pixels, left-right check (BM: block 15). beemap: the stereo "
    "stage's defaults but for the number of disparities, the same for all; it joins two rows into "
    "one where the camera is fine enough (stereo.rows_joined)."
)


def _table(picture: Picture) -> str:
    rows = []
    for name in ("BM", *MODES):
        matcher = opencv_matcher(name, picture.disparities)
        rows.append(
            _row(
                f"OpenCV {name}", picture, lambda m=matcher: m.compute(picture.left, picture.right)
            )
        )
    rows.append(_row("beemap, rows apart", picture, _stage(picture, rows_joined=1)))
    rows.append(_row("**beemap**", picture, _stage(picture)))
    if picture.name in OPENCV_TEST:
        known = f"{OPENCV_TEST[picture.name]:.3f}"
        rows.append(["SGBM, OpenCV's own test", "", "", "", "", known, ""])
    return markdown_table(HEADER, rows)


def _stage(picture: Picture, **settings: object) -> Callable[[], np.ndarray]:
    """The stage's matcher on the rectified pair; rows that were joined are told apart again."""
    ranger = picture.ranger(**settings)
    left, right = ranger.rectify(picture.left, picture.right)
    joined = ranger.camera.rows_joined

    def match() -> np.ndarray:
        disparity = np.repeat(ranger.match(left, right), joined, axis=0)
        last = np.full((len(picture.left) - len(disparity), disparity.shape[1]), -SUBPIXEL)
        return np.vstack([disparity, last])

    return match


def _row(name: str, picture: Picture, match: Callable[[], np.ndarray]) -> list[str]:
    seconds = []
    disparity = np.zeros(0)
    for _ in range(ROUNDS):
        start = time.perf_counter()
        disparity = match().astype(float) / SUBPIXEL
        seconds.append(time.perf_counter() - start)
    answered = disparity > 0
    off = np.abs(disparity - picture.truth)
    fair = picture.inside
    judged = off[fair & answered]
    middle = np.zeros(fair.shape, bool)
    middle[BORDER:-BORDER, BORDER:-BORDER] = True
    wrong = ~answered | (off > 1.0)
    return [
        name,
        f"{np.mean(answered[fair]):.3f}",
        f"{100 * np.mean(judged > 1.0):.1f} %",
        f"{100 * np.mean(judged > 2.0):.1f} %",
        f"{np.median(judged):.3f}",
        f"{np.mean(wrong[middle & picture.seen_by_both]):.3f}",
        f"{1e3 * min(seconds):.1f}",
    ]


if __name__ == "__main__":
    print(main())
