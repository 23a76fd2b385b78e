"""What the bundle adjustment gives: a rig, how well it explains the corners, and its doubt."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.rig import StereoRig
from calibration.sighting import PairSighting


@dataclass(frozen=True, eq=False)
class StereoSolution:
    """A rig solved from views of a board.

    lens: name of the lens model of both cameras, one of `calibration.lens.LENSES`.
    views: what the rig was solved from; points: (m, 3) of the board [m], by id.
    poses: (views, 6) rotation vector and translation [m] that carry the board to the left camera.
    residuals: per view a pair of (n, 2) px arrays, observed less predicted, left and right, for
        every corner of the view's sightings, rejected ones too.
    kept: per view a pair of (n,) bool arrays: the corners that the rig was solved from.
    names: of the rig's parameters, as "left.fx", "right.k1", "rotation.x" [rad],
        "translation.x" [m]; covariance: (p, p) of them, in these units, scaled by the noise
        that the residuals show. "rotation" is a small turn about the right camera's axes.
    outlier_views: indices of views of which an image is wrong as a whole: the rig was solved
        without them (nothing of them is kept), and they count in none of the sums below.
    rejection_capped: more corners looked wrong than the 2 % that may be rejected.
    """

    rig: StereoRig
    lens: str
    views: tuple[PairSighting, ...]
    points: np.ndarray
    poses: np.ndarray
    residuals: tuple[tuple[np.ndarray, np.ndarray], ...]
    kept: tuple[tuple[np.ndarray, np.ndarray], ...]
    names: tuple[str, ...]
    covariance: np.ndarray
    outlier_views: tuple[int, ...] = ()
    rejection_capped: bool = False

    @property
    def sigma(self) -> dict[str, float]:
        """Standard deviation of every parameter of the rig."""
        return dict(zip(self.names, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    @property
    def used_views(self) -> tuple[int, ...]:
        """Indices of the views that the rig was solved from."""
        return tuple(i for i in range(len(self.views)) if i not in self.outlier_views)

    @property
    def rms(self) -> float:
        """Reprojection error over all corners of both images, rejected ones too [px]."""
        return root_mean_square([r for i in self.used_views for r in self.residuals[i]])

    @property
    def rms_kept(self) -> float:
        """Reprojection error over the corners that were not rejected [px]."""
        return root_mean_square(
            [
                r[k]
                for i in self.used_views
                for r, k in zip(self.residuals[i], self.kept[i], strict=True)
            ]
        )

    @property
    def view_rms(self) -> np.ndarray:
        """Reprojection error of each view's left and right image (views, 2) [px], all views."""
        return np.array([[root_mean_square([r]) for r in view] for view in self.residuals])

    @property
    def corners(self) -> int:
        """How many corners were seen, in all images together."""
        return sum(k.size for i in self.used_views for k in self.kept[i])

    @property
    def rejected(self) -> int:
        """How many of them the rig was not solved from."""
        return sum(int(np.count_nonzero(~k)) for i in self.used_views for k in self.kept[i])


def root_mean_square(residuals: list[np.ndarray]) -> float:
    """Root of the mean squared length of 2-vectors in (n, 2) arrays; 0 when there is none."""
    squares = np.concatenate([np.sum(np.square(r), axis=1) for r in residuals])
    return float(np.sqrt(squares.mean())) if squares.size else 0.0
