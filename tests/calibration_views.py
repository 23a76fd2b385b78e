"""Views of a board through a known rig: the truth that calibration must find again."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np

from calibration.board import Board
from calibration.correspondence import pair_sightings
from calibration.detection import detect
from calibration.lens import rays
from calibration.rig import CameraModel, StereoRig
from calibration.sighting import PairSighting, Sighting
from calibration.solution import StereoSolution

BOARD = Board(9, 6, 0.025)
SMALL_RIG = StereoRig(
    (320, 240),
    CameraModel(246.4, 246.4, 159.5, 119.5),
    CameraModel(246.4, 246.4, 159.5, 119.5),
    np.eye(3),
    np.array([-0.12, 0.0, 0.0]),
)
FINE = 4  # rays along each side of a pixel
BLACK, WHITE, AROUND = 20.0, 235.0, 110.0


def distorted_rig() -> StereoRig:
    """A pair of unlike lenses, slightly turned against each other."""
    R = cv2.Rodrigues(np.array([0.004, -0.010, 0.006]))[0]
    return StereoRig(
        (640, 480),
        CameraModel(492.8, 494.1, 322.5, 236.0, "radtan", (-0.28, 0.10, 0.001, -0.0005)),
        CameraModel(489.6, 490.4, 317.0, 243.5, "radtan", (-0.26, 0.08, -0.0008, 0.0004)),
        R,
        np.array([-0.12, 0.0012, -0.0007]),
    )


def random_rig(seed: int, degrees: tuple[float, float] = (50, 100)) -> StereoRig:
    """640x480, a lens of `degrees` across, baseline 60 to 200 mm, all small things unlike."""
    rng = np.random.default_rng((seed, 1))
    f = 320 / np.tan(np.radians(rng.uniform(*degrees)) / 2)
    k1 = rng.uniform(-0.30, 0.02)

    def camera() -> CameraModel:
        k = k1 + rng.normal(0, 0.01)
        # So much of k2 that the image never folds back.
        lens = (k, k * k * rng.uniform(0.8, 1.3), *rng.normal(0, 5e-4, 2))
        fx = f * rng.normal(1, 0.005)
        cx, cy = rng.normal((319.5, 239.5), 5)
        return CameraModel(fx, fx * rng.normal(1, 0.002), cx, cy, "radtan", lens)

    R = cv2.Rodrigues(rng.normal(0, 0.01, 3))[0]
    T = np.array([-rng.uniform(0.06, 0.2), *rng.normal(0, 0.002, 2)])
    return StereoRig((640, 480), camera(), camera(), R, T)


def fisheye_rig(degrees: float, seed: int = 0) -> StereoRig:
    """640x480 with fisheye lenses of `degrees` across the image's width, 100 mm apart."""
    rng = np.random.default_rng((seed, 2))
    f = 320 / np.radians(degrees / 2)

    def camera() -> CameraModel:
        # The image grows outwards by within a few per cent of the equidistant lens's.
        scale = np.arange(3, 10, 2) * np.radians(degrees / 2) ** np.arange(2, 9, 2)
        lens = tuple(rng.normal(0, 0.05, 4) / scale)
        cx, cy = rng.normal((319.5, 239.5), 4)
        return CameraModel(f, f * 1.002, cx, cy, "fisheye", lens)

    R = cv2.Rodrigues(rng.normal(0, 0.01, 3))[0]
    return StereoRig((640, 480), camera(), camera(), R, np.array([-0.1, 0.001, -0.001]))


def board_poses(count: int, seed: int, board: Board = BOARD, distance=(0.35, 0.6)) -> list:
    """Poses (R (3, 3), t (3,) m) of the board in the left camera, tilted to all sides."""
    rng = np.random.default_rng(seed)
    poses = []
    for _ in range(count):
        tilt = rng.uniform(-0.5, 0.5, 3) * (1.0, 1.0, 0.4)
        R = cv2.Rodrigues(tilt)[0]
        z = rng.uniform(*distance)
        centre = np.array([0.06 + rng.uniform(-0.1, 0.1) * z, rng.uniform(-0.15, 0.15) * z, z])
        poses.append((R, centre - R @ board.points.mean(axis=0)))
    return poses


def poses_in_view(rig: StereoRig, count: int, seed: int, board: Board = BOARD) -> list:
    """Poses as a careful person would choose: anywhere in the image, near and far, tilted to all
    sides, the whole board in both images."""
    rng = np.random.default_rng((seed, 3))
    width, height = rig.image_size
    length = np.ptp(board.points[:, 0])
    poses = []
    while len(poses) < count:
        ray = rays(rig.left, rng.uniform((0, 0), (width, height))[None])[0]
        far = length * rig.left.fx / (width * rng.uniform(0.25, 0.6))
        # Facing the camera, then tilted.
        axis = np.cross([0, 0, 1.0], ray)
        facing = cv2.Rodrigues(axis * np.arccos(ray[2]) / max(np.linalg.norm(axis), 1e-9))[0]
        R = facing @ cv2.Rodrigues(rng.uniform(-1, 1, 3) * (0.7, 0.7, 0.4))[0]
        pose = R, ray * far - R @ board.points.mean(axis=0)
        ahead = all((p[:, 2] > 0.05).all() for p in _in_cameras(rig, pose, board))
        if rig.left.distortion_model != "fisheye" and not ahead:
            continue
        if all(_inside(corners, rig.image_size) for corners in project(rig, pose, board)):
            poses.append(pose)
    return poses


def project(rig: StereoRig, pose, board: Board = BOARD) -> tuple[np.ndarray, np.ndarray]:
    """The board's corners (n, 2) in the left and in the right image."""
    left, right = _in_cameras(rig, pose, board)
    return pixels_of(rig.left, left), pixels_of(rig.right, right)


def pixels_of(camera: CameraModel, points: np.ndarray) -> np.ndarray:
    """Points (n, 3) in the camera's frame as pixels (n, 2), by other code than beemap's."""
    if camera.distortion_model != "fisheye":
        zero = np.zeros(3)
        return cv2.projectPoints(points, zero, zero, camera.K, camera.D)[0].reshape(-1, 2)
    # OpenCV's own is wrong for points beside and behind the camera.
    theta = np.arctan2(np.hypot(points[:, 0], points[:, 1]), points[:, 2])
    t = np.polyval([*camera.distortion[::-1], 1.0], theta**2) * theta
    azimuth = np.arctan2(points[:, 1], points[:, 0])
    return np.column_stack(
        [camera.fx * t * np.cos(azimuth) + camera.cx, camera.fy * t * np.sin(azimuth) + camera.cy]
    )


def sightings(
    rig: StereoRig, poses: list, noise: float = 0.0, seed: int = 0, board: Board = BOARD
) -> list[PairSighting]:
    """What both cameras see of the board in these poses, with noise [px] on every coordinate."""
    rng = np.random.default_rng((seed, 4))
    ids = np.arange(len(board.points))
    return [
        PairSighting(*(Sighting(ids, c + rng.normal(0, noise, c.shape)) for c in both))
        for both in (project(rig, pose, board) for pose in poses)
    ]


def shifted(view: PairSighting, shift: tuple[float, float], share: float = 1.0) -> PairSighting:
    """The view with the first `share` of its left image's corners moved by `shift` [px]."""
    corners = view.left.corners.copy()
    corners[: round(share * len(corners))] += shift
    return PairSighting(Sighting(view.left.ids, corners), view.right)


@dataclass(frozen=True)
class Photograph:
    """How images are taken: blur and noise as standard deviations [px], [grey levels]."""

    blur: float = 0.0
    noise: float = 0.0
    seed: int = 0


def render(
    rig: StereoRig,
    pose,
    board: Board = BOARD,
    how: Photograph = Photograph(),
) -> tuple[np.ndarray, np.ndarray]:
    """Both images of the printed chessboard, uint8 (H, W), through the rig's lenses."""
    R, t = pose
    rng = np.random.default_rng((how.seed, 5))
    sides = ((rig.left, R, t), (rig.right, rig.R @ R, rig.R @ t + rig.T))
    images = []
    for camera, R, t in sides:
        image = _photograph(camera, rig.image_size, R, t, board)
        if how.blur:
            image = cv2.GaussianBlur(image, (0, 0), how.blur)
        image = image + rng.normal(0, how.noise, image.shape) if how.noise else image
        images.append(np.clip(np.rint(image), 0, 255).astype(np.uint8))
    return images[0], images[1]


def _photograph(camera: CameraModel, size, R, t, board: Board) -> np.ndarray:
    """Mean brightness over the area of each pixel (H, W)."""
    width, height = size
    ends = np.array([-2, board.columns + 1]), np.array([-2, board.rows + 1])
    rim = board.square * np.stack(np.meshgrid(*ends), axis=-1).reshape(-1, 2)
    outline = pixels_of(camera, rim @ R[:, :2].T + t)
    low = np.clip(np.floor(outline.min(axis=0)) - 3, 0, (width - 2, height - 2)).astype(int)
    high = np.clip(np.ceil(outline.max(axis=0)) + 4, low + 2, (width, height)).astype(int)
    part = slice(low[1], high[1]), slice(low[0], high[0])
    # Where each pixel's centre looks on the board, in squares from corner (0, 0).
    on_board = (
        _directions(camera, size)[part] @ np.linalg.inv(np.column_stack([R[:, 0], R[:, 1], t])).T
    )
    x, y = (on_board[..., axis] / on_board[..., 2] / board.square for axis in (0, 1))
    bright = _brightness(x, y, board)
    # Pixels that an edge may cross are looked at in many places.
    slopes = [(np.gradient(axis, axis=0), np.gradient(axis, axis=1)) for axis in (x, y)]
    mixed = np.zeros(x.shape, bool)
    for axis, (down, along) in zip((x, y), slopes, strict=True):
        mixed |= np.abs(axis - np.rint(axis)) <= 0.5 * (np.abs(down) + np.abs(along)) + 1e-3
    places = (np.arange(FINE) + 0.5) / FINE - 0.5
    u, v = (axis.ravel() for axis in np.meshgrid(places, places))
    xs, ys = (
        axis[mixed][:, None] + down[mixed][:, None] * v + along[mixed][:, None] * u
        for axis, (down, along) in zip((x, y), slopes, strict=True)
    )
    bright[mixed] = _brightness(xs, ys, board).mean(axis=1)
    image = np.full((height, width), AROUND)
    image[part] = bright
    return image


def _brightness(x: np.ndarray, y: np.ndarray, board: Board) -> np.ndarray:
    """Of the sheet at places in squares; corner (0, 0) has a square before it, and that a rim."""
    column, row = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    printed = (column >= -1) & (column < board.columns) & (row >= -1) & (row < board.rows)
    sheet = (column >= -2) & (column <= board.columns) & (row >= -2) & (row <= board.rows)
    black = printed & ((column + row) % 2 == 0)
    return np.where(black, BLACK, np.where(sheet, WHITE, AROUND))


def undistorted(points: np.ndarray, K, D, R, P) -> np.ndarray:
    """OpenCV's undistortPoints of (n, 2) px, iterated to the end; 5.0 has one name less for it."""
    until = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-12)
    if hasattr(cv2, "undistortPointsIter"):
        return np.asarray(cv2.undistortPointsIter(points, K, D, R, P, until)).reshape(-1, 2)
    flat = cv2.undistortPoints(points, K, D, None, R, P, until)  # pyright: ignore[reportCallIssue, reportArgumentType]
    return np.asarray(flat).reshape(-1, 2)


@lru_cache(maxsize=4)
def _directions(camera: CameraModel, size: tuple[int, int]) -> np.ndarray:
    """Where every pixel looks (H, W, 3), for pinhole lenses by other code than beemap's."""
    pixels = np.stack(np.meshgrid(*map(np.arange, size)), axis=-1).reshape(-1, 2).astype(float)
    if camera.distortion_model == "fisheye":
        return rays(camera, pixels).reshape(size[1], size[0], 3)
    flat = undistorted(pixels, camera.K, camera.D, np.eye(3), np.eye(3))
    ahead = np.column_stack([flat, np.ones(len(pixels))])
    return ahead.reshape(size[1], size[0], 3)


def _in_cameras(rig: StereoRig, pose, board: Board) -> tuple[np.ndarray, np.ndarray]:
    R, t = pose
    left = board.points @ R.T + t
    return left, left @ rig.R.T + rig.T


def _inside(corners: np.ndarray, size: tuple[int, int], margin: float = 6.0) -> bool:
    return bool(((corners > margin) & (corners < np.array(size) - 1 - margin)).all())


def photographed(
    rig: StereoRig, poses: list, how: Photograph, board: Board = BOARD
) -> list[PairSighting]:
    """What is found of the board in rendered images; poses without it are left out."""
    views = []
    for number, pose in enumerate(poses):
        images = render(rig, pose, board, replace(how, seed=how.seed * 1000 + number))
        left, right = (detect(image, board).sighting for image in images)
        if left is not None and right is not None:
            views.append(pair_sightings(left, right, board)[0])
    return views


def normalised_errors(rig: StereoRig, solution: StereoSolution) -> np.ndarray:
    """(p,) error of every parameter of the solution over its stated standard deviation."""
    found = solution.rig
    errors = []
    for a, b in ((found.left, rig.left), (found.right, rig.right)):
        errors += [a.fx - b.fx, a.fy - b.fy, a.cx - b.cx, a.cy - b.cy]
        errors += list(a.D - b.D)
    errors += [*cv2.Rodrigues(found.R @ rig.R.T)[0].ravel(), *(found.T - rig.T)]
    return np.array(errors) / np.sqrt(np.diag(solution.covariance))
