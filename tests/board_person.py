"""A person who holds a board where the outline asks for it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from calibration.board import Board
from calibration.rig import StereoRig
from calibration.sighting import PairSighting, Sighting
from pipeline.board_capture import alike
from pipeline.board_ghost import Ghost, find_ghost
from pipeline.board_views import BoardViews
from tests.calibration_views import SMALL_RIG, project

Pose = tuple[np.ndarray, np.ndarray]

# Lenses near enough for a board at arm's length.
NEAR_RIG = replace(SMALL_RIG, T=np.array([-0.06, 0.0, 0.0]))


def hold(rig: StereoRig, board: Board, ghost: Ghost) -> Pose:
    """R (3, 3) and t (3,) m of the board that looks like the outline through the true left lens."""
    lens = rig.left.K, rig.left.D
    _, turn, place = cv2.solvePnP(board.points, ghost.seen.corners, *lens)
    return cv2.Rodrigues(turn)[0], place.ravel()


@dataclass(frozen=True)
class Followed:
    """What was asked for and how the board was held, view by view; views: what was covered before
    each, and after the last."""

    ghosts: list[Ghost]
    poses: list[Pose]
    views: list[BoardViews]


def follow(rig: StereoRig, board: Board, most: int = 30) -> Followed:
    """Hold the board where it is asked for, again and again, until there is enough.

    Every view is one that is taken: whole within both images, and new.
    """
    done = Followed([], [], [BoardViews(board, rig.image_size)])
    ids = np.arange(len(board.points))
    while (views := done.views[-1]).wishes and len(done.poses) < most:
        ghost = find_ghost(views)
        assert ghost is not None, views.wishes
        pose = hold(rig, board, ghost)
        left, right = (Sighting(ids, corners) for corners in project(rig, pose, board))
        for seen in (left, right):
            last = np.array(rig.image_size) - 1
            assert ((seen.corners > 0) & (seen.corners < last)).all(), str(ghost.wish)
        assert not any(alike(left, kept.left, rig.image_size[0]) for kept in views.kept)
        done.ghosts.append(ghost)
        done.poses.append(pose)
        done.views.append(replace(views, kept=(*views.kept, PairSighting(left, right))))
    return done
