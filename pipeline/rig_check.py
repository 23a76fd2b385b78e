"""Has a rig drifted since it was calibrated? Row errors on ordinary scenes, and a verdict."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np

from calibration.rig import StereoRig
from pipeline.errors import InputError
from pipeline.frontend import IMAGE_ERRORS, ahead, damage_of
from pipeline.recordings.base import DamagedFrameError, RecordedPair, Recording
from pipeline.whole_images import spread, whole_rectifier
from stereo.errors import StereoError
from stereo.rectify import Rectifier
from stereo.row_check import LEAST_MATCHES, RowCheck, RowMatches, check_rows, match_points

# Row errors that calibrating again would take away may reach this [px], or half as much again as
# the rig had when it was new.
DRIFT = 0.3
SINCE_NEW = 1.5
# Pairs whose rows differ from each other by more than this were not exposed at once [px].
UNSTEADY = 0.15

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class DriftCheck:
    """rows: what was measured; limit: of its systematic part [px]; pairs: looked at; notes: what
    else the user should know."""

    rows: RowCheck
    limit: float
    pairs: int
    notes: list[str]

    @property
    def drifted(self) -> bool:
        """Whether the rig should be calibrated again."""
        return self.rows.systematic > self.limit


def check_rig(rig: StereoRig, recording: Recording, pairs: int, progress: Progress) -> DriftCheck:
    """Measure the rectified row error of a rig on at most `pairs` pairs, spread evenly.

    Raises:
        StereoError: too few points match, or no image has the rig's size; InputError: no pair can
        be read, or left and right are exchanged.
    """
    rectify = whole_rectifier(rig)
    files = spread(recording.pairs, pairs)
    found: list[RowMatches] = []
    wrong: StereoError | None = None

    def look(pair: RecordedPair) -> RowMatches | Exception:
        try:
            loaded = pair.load()
            return match_points(*rectify(loaded.left, loaded.right))
        except (DamagedFrameError, StereoError) as error:
            return error
        except cv2.error as error:
            return DamagedFrameError(damage_of(pair, error))

    for done, (_, matches) in enumerate(ahead(files, look, os.cpu_count() or 1), start=1):
        progress(done, len(files))
        if isinstance(matches, RowMatches):
            found.append(matches)
            continue
        if isinstance(matches, StereoError):
            wrong = matches
        recording.skip("damaged or unfit image", [str(matches)])
    if not found:
        raise wrong or InputError(f"{recording.path}: none of {len(files)} pairs can be read")
    _refuse_exchanged(found, files, rectify, recording)
    rows = check_rows(found, rectify.camera)
    return DriftCheck(rows, _limit(rig), len(found), _notes(rows))


def _limit(rig: StereoRig) -> float:
    told = rig.sections.get("calibration")
    new = told.get("heldout_row_rms_px") if isinstance(told, dict) else None
    return max(DRIFT, SINCE_NEW * new) if isinstance(new, (int, float)) else DRIFT


def _refuse_exchanged(
    found: list[RowMatches], files: list[RecordedPair], rectify: Rectifier, recording: Recording
) -> None:
    """Things behind infinity, or few matches: perhaps left is right."""
    disparity = np.concatenate([m.left[:, 0] - m.right[:, 0] for m in found])
    if len(disparity) >= LEAST_MATCHES and np.median(disparity) > 0:
        return
    matches = 0
    for pair in files:
        try:
            loaded = pair.load()
            matches += len(match_points(*rectify(loaded.right, loaded.left)).left)
        except IMAGE_ERRORS:
            continue
    if matches > max(len(disparity), LEAST_MATCHES):
        raise InputError(
            f"{recording.path}: the left and right images look exchanged: give them the other way"
        )


def _notes(rows: RowCheck) -> list[str]:
    notes = []
    if rows.scatter > UNSTEADY:
        notes.append(
            f"row errors change from pair to pair by {rows.scatter:.2f} px: the cameras do not "
            "expose at the same time, or the lens or mount is loose; check with the robot at rest"
        )
    return notes
