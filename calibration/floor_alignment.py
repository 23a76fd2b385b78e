"""The floor to a hundredth of a pixel: both images of many pairs aligned through one plane.

Block matching errs by a tenth of a pixel and more on a slanted floor, alike in all frames, so
that no averaging helps. Here the right image is warped through the plane onto the left one and
the plane is turned until they agree (Gauss-Newton over its three numbers, robust in the grey
levels; Lucas and Kanade 1981, with the plane of `calibration.floor` as the warp).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from calibration.errors import CalibrationError
from calibration.floor import NO_FLOOR, TOLERANCE, RectifiedView

# Noise is smoothed away before gradients are taken; brightness that differs between the cameras
# is taken out over this many pixels.
SMOOTHING = 1.0
BRIGHTNESS = 3.0
# Farther floor tells little, and block matching smears the foot of walls over it [px].
LEAST_DISPARITY = 3.0
# Holes in the floor's disparity up to this size are filled, then the border with other things is
# left out by this much [px].
HOLES = 5
BORDER = 9
LEAST_PIXELS = 500  # of floor in a frame that counts
LEAST_FRAMES = 3
ROUNDS = 3  # of finding the floor's pixels by the plane so far
STEPS = 6  # of Gauss-Newton at most in a round
CONVERGED = 2e-3  # a step that moves no disparity by more than this is the last [px]
TUKEY = 4.685


@dataclass(frozen=True)
class FloorFrame:
    """One rectified pair: left, right uint8 (H, W); disparity (H, W) px, negative = no match."""

    left: np.ndarray
    right: np.ndarray
    disparity: np.ndarray


@dataclass(frozen=True)
class Alignment:
    """plane (3,) and its covariance (3, 3), from the scatter over `frames` frames."""

    plane: np.ndarray
    covariance: np.ndarray
    frames: int


@dataclass(frozen=True)
class _System:
    """Normal equations of one frame for a small change of the plane: A step = b."""

    A: np.ndarray
    b: np.ndarray


Each = Callable[[Callable[[FloorFrame], "_System | None"]], Iterable["_System | None"]]


def align_floor(frames: Sequence[FloorFrame], view: RectifiedView, plane: np.ndarray) -> Alignment:
    """The plane that aligns all frames best, beginning at `plane`, which is right to a pixel.

    Raises:
        CalibrationError: fewer than three frames show enough of the floor.
    """
    smooth = [(_smoothed(frame.left), _smoothed(frame.right)) for frame in frames]
    systems: list[_System] = []
    for _ in range(ROUNDS):
        masks = [floor_pixels(frame.disparity, view, plane) for frame in frames]
        shown = [i for i, mask in enumerate(masks) if mask.sum() >= LEAST_PIXELS]
        if len(shown) < LEAST_FRAMES:
            raise CalibrationError(f"{NO_FLOOR} (it shows in {len(shown)} of {len(frames)} pairs)")
        for _ in range(STEPS):
            systems = [_system(*smooth[i], masks[i], view, plane) for i in shown]
            step = _solve(systems)
            plane = plane + step
            if _moved(step, masks[0].shape) < CONVERGED:
                break
    return Alignment(plane, _jackknife(systems), len(systems))


def floor_pixels(disparity: np.ndarray, view: RectifiedView, plane: np.ndarray) -> np.ndarray:
    """Mask (H, W) of the pixels that show the floor, well inside its border."""
    u, v = _grid(disparity.shape)
    expected = view.disparity(plane, u, v)
    near = (disparity > 0) & (abs(disparity - expected) < TOLERANCE)
    mask = (near & (expected > LEAST_DISPARITY)).astype(np.uint8)
    mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((HOLES, HOLES), np.uint8))
    mask = cv2.erode(mask, np.ones((BORDER, BORDER), np.uint8))
    # The warp and its gradient stay inside the right image.
    return mask.astype(bool) & (u - expected > 2) & (u > 2) & (u < disparity.shape[1] - 3)


def _grid(shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Columns and rows of all pixels, float32 (H, W) each."""
    rows, columns = (np.arange(n, dtype=np.float32) for n in shape)
    u, v = np.meshgrid(columns, rows)
    return u, v


def _smoothed(image: np.ndarray) -> np.ndarray:
    return cv2.GaussianBlur(image.astype(np.float32), (0, 0), SMOOTHING)


def _system(
    left: np.ndarray,
    right: np.ndarray,
    mask: np.ndarray,
    view: RectifiedView,
    plane: np.ndarray,
) -> _System:
    """Robust normal equations of one frame."""
    u, v = _grid(left.shape)
    disparity = view.disparity(plane, u, v).astype(np.float32)
    warped = cv2.remap(right, u - disparity, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    difference = warped - left
    difference -= cv2.GaussianBlur(difference, (0, 0), BRIGHTNESS)
    # More disparity looks further left in the right image. The mean of both images' gradients
    # keeps the noise of the one from pulling the plane.
    gradient = -0.5 * (np.gradient(warped, axis=1) / (1.0 - plane[0]) + np.gradient(left, axis=1))
    J = np.stack([u[mask] - view.cx, v[mask] - view.cy, np.ones(mask.sum())], axis=1)
    J *= gradient[mask][:, None]
    r = difference[mask]
    scale = 1.4826 * float(np.median(abs(r))) + 1e-6
    weight = np.clip(1.0 - (r / (TUKEY * scale)) ** 2, 0.0, None) ** 2 / scale**2
    return _System((J * weight[:, None]).T @ J, -J.T @ (weight * r))


def _solve(systems: Sequence[_System]) -> np.ndarray:
    A, b = sum(s.A for s in systems), sum(s.b for s in systems)
    try:
        return np.linalg.solve(A, b)
    except np.linalg.LinAlgError:
        raise CalibrationError(f"{NO_FLOOR} (its surface has no texture at all)") from None


def _moved(step: np.ndarray, shape: tuple[int, ...]) -> float:
    """Largest change of a disparity in the image, about [px]."""
    return float(abs(step) @ (shape[1] / 2.0, shape[0] / 2.0, 1.0))


def _jackknife(systems: Sequence[_System]) -> np.ndarray:
    """Covariance (3, 3) of the plane: how much it moves when a frame is left out."""
    A, b = sum(s.A for s in systems), sum(s.b for s in systems)
    without = np.array([np.linalg.solve(A - s.A, b - s.b) for s in systems])
    spread = without - without.mean(axis=0)
    return (len(systems) - 1) / len(systems) * spread.T @ spread
