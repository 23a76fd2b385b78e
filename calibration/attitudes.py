"""How differently the boards stood: tilts and distances.

Boards parallel to the image tell nothing of the focal length (Zhang 2000, Sec. 4), tilts about
one axis only tell little of the principal point, and boards at one distance leave the lens and
the distance free to trade.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.rotation import turn_matrix

TILTED = np.radians(12.0)  # a board tilted by less is of little use for the focal length
TILTED_SHARE = 0.15  # of the views to each side, and at least one, makes good tilts
FAR_TO_NEAR = 1.3  # ratio of distances that makes boards differ in distance

# What the person at the board does: which of its edges comes towards the cameras.
SIDES = ("upper", "lower", "left", "right")


@dataclass(frozen=True, eq=False)
class Attitudes:
    """How each view's board stood in front of the left camera.

    tilts: (views, 2) rad: of the board's face about the image's horizontal axis (positive: the
        upper edge is nearer) and about its vertical axis (positive: the right edge is nearer).
    distances: (views,) of the board's middle along the optical axis [m].
    """

    tilts: np.ndarray
    distances: np.ndarray

    @property
    def tilted(self) -> dict[str, int]:
        """For each edge of the board, in how many views it was clearly the nearer one."""
        about_x, about_y = self.tilts.T
        nearer = (about_x > TILTED, about_x < -TILTED, about_y < -TILTED, about_y > TILTED)
        return {
            side: int(np.count_nonzero(views)) for side, views in zip(SIDES, nearer, strict=True)
        }

    @property
    def lacking(self) -> list[str]:
        """The edges that were too seldom the nearer one, the rarest first."""
        wanted = max(1.0, TILTED_SHARE * len(self.tilts))
        tilted = self.tilted
        return [side for side in sorted(SIDES, key=tilted.__getitem__) if tilted[side] < wanted]

    @property
    def one_distance(self) -> bool:
        """Whether all boards stood about equally far away."""
        return bool(self.distances.max() < FAR_TO_NEAR * self.distances.min())


def attitudes(poses: np.ndarray, points: np.ndarray) -> Attitudes:
    """The attitudes of boards.

    Args:
        poses: (views, 6) rotation vector and translation [m] that carry the board to the camera.
        points: (m, 3) of the board [m], z = 0.
    """
    R = turn_matrix(poses[:, :3])
    normal = R[:, :, 2]
    # Away from the camera, whichever way round the board's numbering runs.
    away = normal * np.sign(normal[:, 2:])
    tilts = np.stack(
        [np.arctan2(-away[:, 1], away[:, 2]), np.arctan2(away[:, 0], away[:, 2])], axis=1
    )
    middle = R @ points.mean(axis=0) + poses[:, 3:]
    return Attitudes(tilts, middle[:, 2])
