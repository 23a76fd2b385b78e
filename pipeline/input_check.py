"""Before a recording is mapped: do its rows fit, are its pairs simultaneous, does the floor lie
where the rig's mount has it? A look at a few pairs, spread over the recording."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calibration.errors import CalibrationError
from calibration.floor import find_floor
from calibration.floor_alignment import FloorFrame
from calibration.mount import drawn_samples
from calibration.rig import Mount, StereoRig
from pipeline.errors import InputError
from pipeline.frontend import IMAGE_ERRORS
from pipeline.health.finding import Finding, Grade
from pipeline.mount import WIDEST, floor_matcher, level_view, look_at_floor, reduced
from pipeline.recordings.base import Recording
from pipeline.run_report.origin import Origin
from pipeline.whole_images import whole_rectifier
from stereo.disparity import SUBPIXEL
from stereo.errors import StereoError
from stereo.pair import StereoPair
from stereo.pair_check import check_pair
from stereo.rectify import Rectifier
from stereo.row_check import RowMatches, check_rows, match_points

SAMPLES = 6
# A pair with fewer matches between left and right says nothing of rows or time.
MIN_MATCHES = 25
MIN_PAIRS = 3
# A constant row offset below the first is left alone: stereo matching averages over a block of
# rows. One above the second may come with a turn about another axis, which a shift does not mend
# [px of the camera].
MIN_OFFSET, MAX_OFFSET = 0.5, 2.0
# What rows differ by beside a constant offset (RMS) and is worth a word; beyond MAX_OFFSET it
# ends the run [px of the camera].
MIN_UNEVEN = 1.0
CERTAIN = 3.0  # standard errors
# Right images as many frames late or early are looked for.
MAX_LATE = 6
# A match counts for a pair of images by how near its row difference is to their median, up to
# this [px].
SAME_ROW = 1.0
# Of the matches of simultaneous pairs at least this share counts (of eight recordings 0.95).
CONSISTENT = 0.75
# Another pairing is the right one when it explains so much more, and so in nearly every pair in
# which the two differ.
BETTER, DIFFERENT, NEARLY_ALL = 1.15, 1.05, 0.8
# The floor's pitch and roll come out of a few small images to some tenths of a degree. A mount
# wrong by more than this lifts floor 2 m away by 5 cm, to where obstacles are looked for [rad].
MAX_TILT = math.radians(1.5)
# A tilt larger than this is no sagging bracket: whoever wrote the rig is asked [rad].
MAX_MENDED = math.radians(6.0)
# Seen at a glance, the floor is looked at thoroughly from here on; it must then be known to so
# much [rad].
SUSPICIOUS, KNOWN_TILT = math.radians(1.0), math.radians(0.3)
FLOOR_SAMPLES, FLOOR_WIDTH, FLOOR_POINTS = 10, 400, 4000  # pairs, px, disparities: of a glance
FLOOR_PAIRS = 40  # of a thorough look, as `beemap calibrate mount` takes
# Rough ground tilts a robot for some seconds: a shorter recording says nothing of the mount [ns].
MIN_DURATION = 10_000_000_000
CALIBRATE_MOUNT = "beemap calibrate mount {recording}{rate_option}{rig_option} -o mounted.yaml"


@dataclass(frozen=True)
class InputCheck:
    """rig: with what was mended; findings: for the report, in words."""

    rig: StereoRig
    findings: list[Finding]


@dataclass(frozen=True)
class _Fault:
    """finding: what is wrong, and the remedy; mended: the rig without it; fatal: a map made in
    spite of it is wrong from the start."""

    finding: Finding
    mended: StereoRig | None = None
    fatal: bool = False

    def remedy(self, origin: Origin) -> str:
        """With its commands filled in."""
        command = origin.fill(self.finding.command)
        return origin.fill(self.finding.remedy.replace("{command}", f"'{command}'"))


def check_input(
    recording: Recording, rig: StereoRig, origin: Origin, unchecked: bool = False
) -> InputCheck:
    """Check a few pairs of a recording against the rig.

    origin: of the run, for the commands that are named. unchecked: nothing is mended and nothing
    ends the run; what is wrong is reported all the same.

    Raises:
        InputError: a fault that would make the map wrong from the start.
    """
    findings = []
    for check in (_check_pairs, _check_mount):
        try:
            fault = check(recording, rig)
        except (InputError, StereoError):
            break  # rig and images do not fit at all: who maps them says so
        if fault is None:
            continue
        finding = fault.finding
        if fault.mended is not None and not unchecked:
            rig = fault.mended
            finding = replace(
                finding, text=f"{finding.text}: corrected in this run", grade=Grade.GOOD, short=""
            )
        elif fault.fatal and not unchecked:
            raise InputError(
                f"{recording.path}: {finding.text}: {fault.remedy(origin)} (or --unchecked: map "
                "it as it is)"
            )
        findings.append(replace(finding, remedy=fault.remedy(origin)))
    return InputCheck(rig, findings)


class _Looks:
    """Reduced, rectified images of a recording, as if the camera were level; scale: pixels of the
    camera in one of theirs; pairs: how many there are."""

    def __init__(self, recording: Recording, rig: StereoRig, widest: int = WIDEST) -> None:
        self._pairs = recording.pairs
        self.pairs = len(recording.pairs)
        small, self._reduce = reduced(rig, widest)
        self.rectify: Rectifier = whole_rectifier(small)
        self.scale = rig.image_size[0] // small.image_size[0]

    def samples(self, most: int = SAMPLES, reach: int = 0) -> list[int]:
        """Numbers of pairs, at most so many, evenly spread, `reach` away from both ends."""
        first, last = reach, len(self._pairs) - 1 - reach
        if last < first:
            return []
        count = min(most, last - first + 1)
        return sorted(set(np.linspace(first, last, count).round().astype(int).tolist()))

    def load(self, number: int) -> StereoPair | None:
        """A rectified pair; None: it cannot be read or is no stereo."""
        try:
            pair = self._pairs[number].load()
            if check_pair(pair.left, pair.right).defect:
                return None
            images = self.rectify(self._reduce(pair.left), self._reduce(pair.right))
        except IMAGE_ERRORS:
            return None
        return StereoPair(pair.stamp, *images)


def _check_pairs(recording: Recording, rig: StereoRig) -> _Fault | None:
    """Rows, and the step in time between left and right."""
    looks = _Looks(recording, rig)
    matches, late = _matches(looks, 1)
    many = [m for m in matches if len(m.left) >= MIN_MATCHES]
    disparity = np.concatenate([np.zeros(0), *(m.left[:, 0] - m.right[:, 0] for m in many)])
    same_row = sum(float(_on_row(m).sum()) for m in many) > CONSISTENT * len(disparity)
    if len(disparity) and np.median(disparity) < 0.0 and _look_exchanged(looks, matches):
        return None  # `check_images` says so
    rows = _check_rows(many, rig, looks) if len(many) >= MIN_PAIRS else None
    # Images taken apart have other rows, too, and after many frames nothing in common.
    if late or rows or not same_row or 2 * len(many) <= len(matches):
        _, late = _matches(looks, MAX_LATE)
    return _late(late) if late else rows


def _matches(looks: _Looks, reach: int) -> tuple[list[RowMatches], int]:
    """Of each sampled left image with its right one; and how many frames later the right image
    that fits it better comes, of at most `reach`; 0: none does."""
    together, scores = [], []
    reach = max(0, min(reach, (looks.pairs - MIN_PAIRS) // 2))
    steps = range(-reach, reach + 1)
    for number in looks.samples(reach=reach):
        near = {step: looks.load(number + step) for step in steps}
        here = near.get(0)
        if here is None:
            continue
        found = {s: match_points(here.left, p.right) for s, p in near.items() if p is not None}
        together.append(found[0])
        if len(found) == 2 * reach + 1:
            scores.append([_consistent(found[step]) for step in steps])
    return together, _better(np.array(scores), reach)


def _look_exchanged(looks: _Looks, matches: Sequence[RowMatches]) -> bool:
    """Whether more fits when left is taken for right."""
    pairs = [pair for n in looks.samples() if (pair := looks.load(n)) is not None]
    exchanged = sum(_consistent(match_points(pair.right, pair.left)) for pair in pairs)
    return exchanged > BETTER * sum(map(_consistent, matches))


def _consistent(matches: RowMatches) -> float:
    """How many matches lie on the same row and before the cameras."""
    if len(matches.left) < MIN_MATCHES:
        return 0.0
    ahead = matches.left[:, 0] - matches.right[:, 0] > -SAME_ROW
    return float(_on_row(matches)[ahead].sum())


def _on_row(matches: RowMatches) -> np.ndarray:
    """How near the same row each match lies, but for an offset of all (n,): 1 on it, 0 off it."""
    off = (matches.differences - np.median(matches.differences)) / SAME_ROW
    return np.clip(1.0 - off**2, 0.0, None)


def _better(scores: np.ndarray, reach: int) -> int:
    """The step in time of the best scores (pairs, 2 reach + 1), where it is certain."""
    if len(scores) < MIN_PAIRS:
        return 0
    best = int(scores.sum(axis=0).argmax())
    ours, others = scores[:, reach], scores[:, best]
    if others.sum() < max(BETTER * ours.sum(), MIN_PAIRS * MIN_MATCHES):
        return 0
    # Where the robot stands all are alike.
    different = np.maximum(ours, others) > DIFFERENT * np.minimum(ours, others)
    wins = int(np.sum(different & (others > ours)))
    return best - reach if wins >= max(MIN_PAIRS, NEARLY_ALL * different.sum()) else 0


def _late(step: int) -> _Fault:
    count, word = abs(step), "late" if step > 0 else "early"
    frames, first = ("1 frame", "frame") if count == 1 else (f"{count} frames", f"{count} frames")
    # The right image that belongs to left image n is number n + step.
    side = "right" if step > 0 else "left"
    text = f"the right images are {frames} {word}"
    finding = Finding(
        f"{text}: left image n fits right image n{step:+d}",
        f"drop the first {first} of the {side} camera, or map with --right-late {step}",
        grade=Grade.DOUBTFUL,
        short=text,
    )
    return _Fault(finding, fatal=True)


def _check_rows(many: Sequence[RowMatches], rig: StereoRig, looks: _Looks) -> _Fault | None:
    """A constant row offset, and what is no constant one."""
    camera = looks.rectify.camera
    offsets = np.array([np.median(m.differences) for m in many]) * looks.scale
    offset = float(np.median(offsets))
    error = 1.2533 * float(offsets.std(ddof=1)) / math.sqrt(len(offsets))  # of a median
    level = [replace(m, right=m.right - (0.0, offset / looks.scale)) for m in many]
    uneven = check_rows(level, camera).systematic * looks.scale
    certain = abs(offset) > max(MIN_OFFSET, CERTAIN * error)
    if not certain and uneven <= MIN_UNEVEN:
        return None
    lower = "lower" if offset > 0 else "higher"
    text = f"the right images lie {abs(offset):.1f} px {lower} than the left ones"
    if uneven > MIN_UNEVEN:
        text = f"rows of left and right images differ by {math.hypot(offset, uneven):.1f} px (RMS)"
    elif abs(offset) <= MAX_OFFSET:
        finding = Finding(
            text,
            "calibrate the cameras again ('beemap calibrate cameras')",
            grade=Grade.DOUBTFUL,
            short=text,
        )
        return _Fault(finding, _shifted(rig, offset, looks.rectify))
    finding = Finding(
        text,
        "the cameras have moved since they were calibrated, or the rig is not theirs: calibrate "
        "them again ('beemap calibrate cameras'), or give their rig with --rig",
        grade=Grade.DOUBTFUL,
        short=text,
        command="beemap rig check {rig} {recording}",
    )
    return _Fault(finding, fatal=max(abs(offset), uneven) > MAX_OFFSET)


def _shifted(rig: StereoRig, offset: float, rectify: Rectifier) -> StereoRig:
    """The rig whose rectified right images lie `offset` px higher: the principal point moves as
    the rows do, along the rectified y axis as the raw right camera sees it."""
    x, y = (rig.R @ rectify.camera.rotation.T @ Mount().rotation)[:2, :2] @ (0.0, offset)
    right = replace(rig.right, cx=rig.right.cx + float(x), cy=rig.right.cy + float(y))
    return replace(rig, right=right, rectified=False)


def _check_mount(recording: Recording, rig: StereoRig) -> _Fault | None:
    """The floor against the rig's mount: at a glance, and thoroughly where that looks wrong."""
    mount = rig.mount or Mount()
    pairs = recording.pairs
    if not pairs or pairs[-1].stamp - pairs[0].stamp < MIN_DURATION:
        return None
    glance = _glance_at_floor(recording, rig)
    if glance is None or not _tilts(glance, mount, SUSPICIOUS):
        return None
    try:
        # What is damaged is counted when its turn comes.
        aside = replace(recording, skipped={})
        floor, looked = look_at_floor(aside, rig, FLOOR_PAIRS, lambda done, total: None)
    except CalibrationError:
        return None
    tilts = _tilts(replace(mount, pitch=floor.pitch, roll=floor.roll), mount, MAX_TILT)
    sure = max(floor.sigma[1:]) < KNOWN_TILT and 2 * floor.frames >= looked
    if not tilts or not sure:
        return None
    wrong = " and ".join(tilts.values())
    mended = replace(mount, height=floor.height, pitch=floor.pitch, roll=floor.roll)
    finding = Finding(
        f"the floor shows that the mount in the rig is wrong: {wrong}",
        "measure the mount ({command}), then map with --rig mounted.yaml",
        grade=Grade.DOUBTFUL,
        short=f"the mount in the rig is wrong: {wrong}",
        command=CALIBRATE_MOUNT,
    )
    if _tilts(mended, mount, MAX_MENDED):
        return _Fault(finding, fatal=True)
    return _Fault(finding, mended=rig.with_mount(mended))


def _glance_at_floor(recording: Recording, rig: StereoRig) -> Mount | None:
    """Height, pitch and roll to half a degree or so; None: no floor in view."""
    looks = _Looks(recording, rig, FLOOR_WIDTH)
    match = floor_matcher(looks.rectify)
    frames = [
        FloorFrame(p.left, p.right, match(p.left, p.right).astype(np.float32) / SUBPIXEL)
        for n in looks.samples(FLOOR_SAMPLES)
        if (p := looks.load(n)) is not None
    ]
    view = level_view(looks.rectify)
    try:
        floor = find_floor(drawn_samples(frames, 0, FLOOR_POINTS), view)
    except CalibrationError:
        return None
    height, pitch, roll = view.mount(floor).tolist()
    return Mount(height, pitch, roll)


def _tilts(seen: Mount, mount: Mount, limit: float) -> dict[str, str]:
    """Pitch and roll that differ by more than the limit [rad], in words."""
    return {
        name: f"its {name} is {_degrees(is_)} deg, not {_degrees(said)}"
        for name in ("pitch", "roll")
        if abs((is_ := getattr(seen, name)) - (said := getattr(mount, name))) > limit
    }


def _degrees(angle: float) -> str:
    """To a tenth, and never as -0.0."""
    return f"{round(math.degrees(angle), 1) + 0.0:.1f}"
