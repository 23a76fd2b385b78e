"""Image pairs where time does not matter: a recording, folders, globs, side-by-side images."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from calibration.imagepairs import ImagePair, find_pairs
from pipeline.recordings import asl, kitti, open_recording
from pipeline.recordings.base import HalvedPair, PairFiles, RecordedPair, Recording


def open_pairs(sources: Sequence[str]) -> Recording:
    """The pairs of a recording, or of one or two folders or globs as `find_pairs` takes them.

    Stamps of what is no recording only number the pairs.

    Raises:
        InputError, CalibrationError: no pairs are there.
    """
    path = Path(sources[0])
    if len(sources) == 1 and (asl.recognises(path) or kitti.recognises(path)):
        return open_recording(path)
    found = find_pairs(*sources)
    recording = Recording(path, "images", [_files(n, pair) for n, pair in enumerate(found.pairs)])
    recording.skip("image without a partner", [path.name for path in found.unmatched])
    return recording


def _files(number: int, pair: ImagePair) -> RecordedPair:
    if pair.left.half is not None:
        return HalvedPair(number, pair.left.path)
    return PairFiles(number, pair.left.path, pair.right.path)
