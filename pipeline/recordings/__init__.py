"""Recordings and scan logs: one file per format, recognised from the path."""

from __future__ import annotations

from pathlib import Path

from pipeline.errors import InputError
from pipeline.recordings.base import Recording
from pipeline.recordings.scan_log import ENDINGS, ScanLog


def open_input(path: Path, fps: float | None = None) -> Recording | ScanLog:
    """Open what lies at the path: a file is a scan log, a folder a recording.

    Raises:
        InputError: it is neither; see `open_recording`, `read_carmen` and `read_mines`.
    """
    from pipeline.recordings import mines
    from pipeline.recordings.carmen import read_carmen
    from pipeline.recordings.video import is_video

    if path.is_file() and is_video(path):
        return open_recording(path, fps)
    if path.is_file() and mines.recognises(path):
        return mines.read_mines(path)
    if path.is_file() or (path.suffix.lower() in ENDINGS and not path.is_dir()):
        return read_carmen(path)
    return open_recording(path, fps)


def open_recording(path: str | Path, fps: float | None = None) -> Recording:
    """Open a recording of any known format.

    Raises:
        InputError: no such folder; unknown format, with what was looked for.
    """
    from pipeline.recordings import asl, folders, kitti, video

    path = Path(path)
    if not path.exists():
        raise InputError(f"{path}: no such folder")
    if path.is_file() and video.is_video(path):
        return video.read(path, fps)
    if asl.recognises(path):
        return asl.read(path)
    if kitti.recognises(path):
        return kitti.read(path)
    if folders.recognises(path):
        return folders.read(path, fps)
    if video.recognises(path):
        return video.read(path, fps)
    looked = "; ".join(f.LOOKED_FOR for f in (asl, kitti, folders, video))
    raise InputError(f"{path}: not a recording I know (looked for {looked})")
