"""Both cameras and the pose between them, from corners that both saw on a standing board.

each camera alone      focal length and poses by homographies, refined      (start.py)
both together          bundle adjustment with robust weights                (bundle.py)
what does not fit      single corners, at most 2 %, and wholly wrong views  (outliers.py)
least squares          over what is left, until that no longer changes
the doubt              covariance of the cameras, by the noise left over    (covariance.py)
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from calibration.bundle import Geometry, Observations, adjust, linearise
from calibration.covariance import camera_covariance, focal_doubt
from calibration.errors import CalibrationError
from calibration.lens import LENSES, Lens
from calibration.outliers import (
    FEWEST_CORNERS,
    FEWEST_VIEWS,
    Selection,
    robust_adjust,
    select,
    weights_of,
)
from calibration.rig import StereoRig
from calibration.rotation import turn_matrix
from calibration.sighting import PairSighting
from calibration.solution import StereoSolution
from calibration.start import start_pair, start_poses

WORST_RMS = 5.0  # px; a wrong board or mixed-up pairs give tens of pixels
# With boards tilted to all sides the focal length is known to a few tenths of a per cent.
MOST_FOCAL_DOUBT = 0.03
# Boards whose normals all lie within this angle stand parallel.
PARALLEL = np.radians(6.0)
SELECTION_ROUNDS = 10


def solve_stereo(
    views: Sequence[PairSighting],
    points: np.ndarray,
    image_size: tuple[int, int],
    lens: str = "radtan4",
    start: StereoSolution | None = None,
) -> StereoSolution:
    """Calibrate a pair of cameras.

    Args:
        views: what each pair of images shows of the board, at least 4 corners an image; the two
            images of a pair may show different corners.
        points: (m, 3) corners on the board [m], by id.
        image_size: (width, height) of the images of both cameras [px].
        lens: of both cameras, a name in `calibration.lens.LENSES`.
        start: a solution from much the same views to start from, perhaps with a simpler lens;
            one with a lens of another kind is no help and is passed over.

    Raises:
        CalibrationError: fewer than 3 views, views that do not determine the cameras, corners
            that fit no pair of cameras, or cameras swapped.
    """
    views = tuple(views)
    if len(views) < FEWEST_VIEWS:
        raise CalibrationError(
            f"{len(views)} usable pairs are too few: at least {FEWEST_VIEWS} are needed, 10 or "
            "more with the board tilted to all sides are good"
        )
    model = LENSES[lens]
    seen = observe(views, points)
    try:
        geometry = _start(model, seen, image_size, views, start)
        geometry, residuals, selection = settle(model, seen, geometry)
        _check_fit(geometry, residuals, selection, seen)
        covariance = camera_covariance(model, seen, geometry, selection.kept)
    except np.linalg.LinAlgError:
        raise _undetermined() from None
    _check_doubt(geometry, covariance.information)
    return StereoSolution(
        rig=rig_of(model, geometry, image_size),
        lens=lens,
        views=views,
        points=np.asarray(points, float),
        poses=np.array(
            [
                np.concatenate([cv2.Rodrigues(R)[0].ravel(), t])
                for R, t in zip(geometry.board_rotation, geometry.board_position, strict=True)
            ]
        ),
        residuals=_by_view(residuals, seen, views),
        kept=_by_view(selection.kept, seen, views),
        names=covariance.names,
        covariance=covariance.matrix,
        outlier_views=tuple(np.flatnonzero(selection.outlier_views).tolist()),
        rejection_capped=selection.capped,
    )


def settle(
    lens: Lens, seen: Observations, geometry: Geometry
) -> tuple[Geometry, np.ndarray, Selection]:
    """Least squares over the corners that fit, chosen anew until the choice stands.

    Returns:
        the geometry, the residuals (s, v, m, 2) px of all corners, and what it was solved from.
    """
    residuals, _ = linearise(lens, seen, geometry)
    selection = chosen = select(residuals, seen.seen)
    for _ in range(SELECTION_ROUNDS):
        selection = chosen
        weights = weights_of(selection, residuals, seen.seen)
        geometry, residuals = adjust(lens, seen, geometry, weights)
        chosen = select(residuals, seen.seen)
        if chosen.same(selection):
            break
    return geometry, residuals, selection


def observe(views: Sequence[PairSighting], points: np.ndarray) -> Observations:
    """The views' corners as arrays."""
    return Observations.of([[v.left for v in views], [v.right for v in views]], points)


def rig_of(lens: Lens, geometry: Geometry, image_size: tuple[int, int]) -> StereoRig:
    """The pair of cameras as a rig."""
    left, right = (lens.camera(intrinsics) for intrinsics in geometry.intrinsics)
    return StereoRig(image_size, left, right, geometry.R[1], geometry.t[1])


def geometry_of(solution: StereoSolution, lens: Lens) -> Geometry:
    """A solution's cameras and board poses; `lens` is the solution's own or a richer one."""
    rig = solution.rig
    return Geometry(
        np.stack([lens.intrinsics(rig.left), lens.intrinsics(rig.right)]),
        np.stack([np.eye(3), rig.R]),
        np.stack([np.zeros(3), rig.T]),
        turn_matrix(solution.poses[:, :3]),
        solution.poses[:, 3:],
    )


def _start(
    lens: Lens,
    seen: Observations,
    image_size: tuple[int, int],
    views: tuple[PairSighting, ...],
    start: StereoSolution | None,
) -> Geometry:
    fewest = seen.seen.sum(axis=2)
    if fewest.min() < FEWEST_CORNERS:
        view = int(np.argmin(fewest.min(axis=0)))
        raise CalibrationError(
            f"pair {view + 1} of {len(views)} shows {fewest[:, view].min()} corners in an image, "
            f"at least {FEWEST_CORNERS} are needed: leave it out"
        )
    if start is None or not lens.extends(LENSES[start.lens]):
        return robust_adjust(lens, seen, start_pair(lens, seen, image_size))[0]
    geometry = geometry_of(start, lens)
    # Views that the start has seen keep their pose there; new ones are placed by its left camera.
    R, t = start_poses(lens, geometry.intrinsics[0], seen)
    known = {id(view): i for i, view in enumerate(start.views)}
    for i, view in enumerate(views):
        if (place := known.get(id(view))) is not None:
            R[i], t[i] = geometry.board_rotation[place], geometry.board_position[place]
    return Geometry(geometry.intrinsics, geometry.R, geometry.t, R, t)


def _by_view(values: np.ndarray, seen: Observations, views: tuple[PairSighting, ...]):
    """Per view a pair of arrays in the order of the view's own sightings."""
    return tuple(
        (values[0, i, view.left.ids], values[1, i, view.right.ids]) for i, view in enumerate(views)
    )


def _check_fit(
    geometry: Geometry, residuals: np.ndarray, selection: Selection, seen: Observations
) -> None:
    used = residuals[seen.seen & ~selection.outlier_views[None, :, None]]
    rms = float(np.sqrt(np.mean(np.sum(used**2, axis=-1))))
    if not np.isfinite(rms) or rms > WORST_RMS:
        error = f" (reprojection error {rms:.1f} px)" if np.isfinite(rms) else ""
        raise CalibrationError(
            f"the corners fit no pair of cameras{error}: check the counts in --board, and that "
            "both images of a pair show the same instant"
        )
    if geometry.t[1, 0] >= 0:
        raise CalibrationError(
            f"the second camera stands {geometry.t[1, 0] * 1e3:.1f} mm to the left of the first: "
            "LEFT and RIGHT are swapped, give them the other way round"
        )


def _check_doubt(geometry: Geometry, information: np.ndarray) -> None:
    """Refuse views that leave the focal length open, however well they fit."""
    spread = _board_spread(geometry)
    if spread < PARALLEL:
        # Only the exact shape of the lens's distortion, if anything, speaks here.
        raise _undetermined(
            f" (all boards stand parallel, within {np.ceil(np.degrees(spread)):.0f} degrees)"
        )
    doubt = focal_doubt(geometry, information)
    if (geometry.intrinsics[:, :2] <= 0).any() or not doubt < MOST_FOCAL_DOUBT:
        raise _undetermined(
            f" (they leave the focal length open by {100 * doubt:.0f} %)" if doubt < 1 else ""
        )


def _board_spread(geometry: Geometry) -> float:
    """The largest angle between the normals of two boards [rad]."""
    normals = geometry.board_rotation[:, :, 2]
    return float(np.arccos(np.clip(normals @ normals.T, -1, 1)).max())


def _undetermined(why: str = "") -> CalibrationError:
    return CalibrationError(
        f"the views do not determine the cameras{why}: take more pairs, the board tilted by 20 to "
        "40 degrees to all sides"
    )
