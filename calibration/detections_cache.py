"""What was found in an image, kept on disk by the image's content: a second look is instant.

One small JSON file an image and board in `$XDG_CACHE_HOME/beemap/boards`. A damaged file is made
again; a folder that cannot be written costs time, not the result.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from pathlib import Path

import cv2
import numpy as np

from calibration.board import Board
from calibration.detection import Detection
from calibration.sighting import Sighting

VERSION = 2  # to be raised with every change to what detection finds


def default_cache_folder() -> Path:
    """Where detections are kept unless told otherwise: `~/.cache/beemap/boards`."""
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "beemap" / "boards"


def cache_file(folder: Path, data: bytes, half: str | None, board: Board) -> Path:
    """The place for what was found in an image file's bytes.

    The name holds all that detection depends on; the board's size in metres is no part of it.
    """
    share = round(board.marker / board.square, 9) if board.marker else None
    looked_for = [VERSION, cv2.__version__, half, board.name, share, board.dictionary]
    digest = hashlib.sha256(data)
    digest.update(json.dumps(looked_for).encode())
    name = digest.hexdigest()
    return folder / name[:2] / f"{name[2:]}.json"


def load_detection(file: Path, board: Board) -> Detection | None:
    """What was kept, or None when there is nothing, or nothing of use."""
    try:
        return _decoded(json.loads(file.read_bytes()), len(board.points))
    except (OSError, ValueError, TypeError, KeyError, RecursionError):
        return None


def save_detection(file: Path, detection: Detection) -> None:
    """Keep it, if that can be done."""
    seen = detection.sighting
    text = json.dumps(
        {
            "size": detection.size,
            "ids": None if seen is None else seen.ids.tolist(),
            "corners": None if seen is None else seen.corners.tolist(),
            "blur": detection.blur,
            "missing": detection.missing,
        }
    )
    partial = file.with_name(f"{file.name}.part-{os.getpid()}")
    with contextlib.suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        try:
            partial.write_text(text, encoding="utf-8")
            os.replace(partial, file)
        finally:
            partial.unlink(missing_ok=True)


def _decoded(kept: dict, points: int) -> Detection:
    """Raises ValueError, TypeError or KeyError for anything but what `save_detection` writes."""
    width, height = (int(side) for side in kept["size"])
    if kept["ids"] is None:
        return Detection((width, height), None, None, str(kept["missing"]))
    ids, corners = np.array(kept["ids"], np.int64), np.array(kept["corners"], np.float64)
    ascending = ids.ndim == 1 and len(ids) > 0 and bool(np.all(np.diff(ids) > 0))
    if not ascending or ids[0] < 0 or ids[-1] >= points or corners.shape != (len(ids), 2):
        raise ValueError("not the corners of this board")
    if not np.isfinite(corners).all():
        raise ValueError("not pixels")
    return Detection((width, height), Sighting(ids, corners), float(kept["blur"]), None)
