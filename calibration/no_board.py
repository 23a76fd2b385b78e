"""When no image shows the board: what else they show, in one line with the remedy."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace

import cv2
import numpy as np

from calibration.board import KINDS, Board
from calibration.corners import BoardImage
from calibration.detection import SEARCH_SIDE, SMALLEST_SIDE, find_board
from calibration.imagesource import ImageSource
from calibration.markernames import smallest_dictionaries
from calibration.markers import find_markers

LOOKED_AT = 4  # images: enough to see what is there, within a second or two
FEW_MARKERS = 4  # in one image; fewer may be chance
SMALLEST_PATTERN = (3, 3)


def explain_no_board(images: Sequence[BoardImage], board: Board) -> str:
    """Why none of the images that can be read shows the board, as far as they tell.

    The mistakes that people make with this kind of board are tried first (sides exchanged, squares
    counted as corners), then chessboards of any size and markers of all dictionaries.
    """
    missing = sum(image.sighting is None for image in images)
    share = "any" if missing == len(images) else str(missing)
    message = f"no {board.name} in {share} of {len(images)} images"
    pictures = list(_pictures(images))
    tried = list(_mistaken(board))
    for other in tried:
        if any(_shows(picture, other) for picture in pictures):
            return f"{message}, but {other.name} is there: {_advice(board, other)}"
    seen = _markers_seen(pictures)
    if seen is not None:
        return f"{message}, but there are {seen}: {_marker_advice(board)}"
    size = _chessboard_size(pictures)
    if size is not None and board.kind != "chessboard":
        return f"{message}, but there is a chessboard:{size}: give --board chessboard:{size}"
    if size is not None and size not in (board.name.partition(":")[2], _turned(board)):
        return (
            f"{message}, but there is a chessboard of {size} inner corners: give --board "
            f"chessboard:{size}, or show the whole board if it is larger"
        )
    also = ", ".join([*(other.name for other in tried), "chessboards of any size, any markers"])
    rule = {
        "chessboard": "--board counts inner corners (squares less one each way), and the whole "
        "board must be seen, flat and with a white rim",
        "charuco": "--board counts squares, and at least 6 corners must be seen sharply",
        "aprilgrid": "--board counts tags, and at least 2 must be seen sharply, with a white rim",
    }.get(board.kind, f"--board counts {KINDS[board.kind][0]}, and all circles must be seen")
    return f"{message} (tried too: {also}): {rule}"


def _pictures(images: Sequence[BoardImage]) -> Iterator[np.ndarray]:
    """Some of the images, evenly spread, none of them large."""
    readable = [image for image in images if min(image.size or (0, 0)) >= SMALLEST_SIDE]
    count = min(LOOKED_AT, len(readable))
    for n in range(count):
        chosen = readable[n * len(readable) // count]
        picture = ImageSource(chosen.path, chosen.half).read()
        if picture is not None:
            scale = min(1.0, SEARCH_SIDE / max(picture.shape))
            yield cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)


def _mistaken(board: Board) -> Iterator[Board]:
    """Boards that people write as this one."""
    if board.kind == "charuco" and board.dictionary:
        yield replace(board, dictionary=None)
    sizes = [(board.rows, board.columns)]
    if board.kind == "chessboard":
        sizes = [(board.columns - 1, board.rows - 1)]
    elif board.kind == "charuco":
        sizes += [(board.columns + 1, board.rows + 1), (board.rows + 1, board.columns + 1)]
    fewest = KINDS[board.kind][2]
    own = (board.columns, board.rows)
    for columns, rows in dict.fromkeys(size for size in sizes if size != own):
        if min(columns, rows) >= fewest:
            dictionary = board.dictionary if board.kind == "aprilgrid" else None
            yield replace(board, columns=columns, rows=rows, dictionary=dictionary)
    if board.kind in ("circles", "acircles"):
        kind = "acircles" if board.kind == "circles" else "circles"
        yield replace(board, kind=kind)


def _shows(picture: np.ndarray, board: Board) -> bool:
    sighting = find_board(picture, board)
    return sighting is not None and len(sighting.ids) >= 6


def _advice(board: Board, other: Board) -> str:
    if board.name == other.name:
        return f"its markers are of another dictionary than {board.dictionary}: leave it out"
    counts = KINDS[board.kind][0]
    wrong = {"chessboard": ", not squares", "charuco": ", columns first"}.get(board.kind, "")
    return f"--board counts {counts}{wrong}: give --board {other.name}"


def _markers_seen(pictures: Sequence[np.ndarray]) -> str | None:
    """The dictionary most of whose markers are seen in one picture, and which."""
    seen = {}
    for dictionary in smallest_dictionaries(1):
        numbers = [find_markers(picture, dictionary).ids for picture in pictures]
        most = max(numbers, key=len, default=np.empty(0, int))
        if len(most) >= FEW_MARKERS:
            seen[dictionary] = most
    if not seen:
        return None
    dictionary = max(seen, key=lambda name: len(seen[name]))
    last = int(seen[dictionary].max())
    return f"markers of {dictionary} with numbers up to {last}"


def _marker_advice(board: Board) -> str:
    if board.kind == "charuco":
        return "--board counts squares, columns first; count them again, and measure --marker"
    if board.kind == "aprilgrid":
        return "--board counts tags, columns first, of apriltag_36h11 unless --dictionary is given"
    return "is it a ChArUco board? give its squares, as in --board charuco:8x6"


def _chessboard_size(pictures: Sequence[np.ndarray]) -> str | None:
    """Inner corners, the longer side first, of the chessboard that most pictures show."""
    sizes: Counter[tuple[int, int]] = Counter()
    for picture in pictures:
        found, _, squares = cv2.findChessboardCornersSBWithMeta(
            picture, SMALLEST_PATTERN, flags=cv2.CALIB_CB_LARGER | cv2.CALIB_CB_NORMALIZE_IMAGE
        )
        if found and min(squares.shape) > min(SMALLEST_PATTERN):
            sizes[max(squares.shape), min(squares.shape)] += 1
    if not sizes:
        return None
    (columns, rows), votes = sizes.most_common(1)[0]
    return f"{columns}x{rows}" if 2 * votes > len(pictures) else None


def _turned(board: Board) -> str:
    return f"{board.rows}x{board.columns}"
