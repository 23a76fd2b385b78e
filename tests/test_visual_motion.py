"""Motion from rendered pairs: within its covariance, still where the robot is, honest when lost."""

from __future__ import annotations

import functools
import itertools

import numpy as np
import pytest

from odometry.motion import Motion, compose, inverse
from pipeline.fused_motion import FusedMotion
from pipeline.motion_told import told
from pipeline.recordings import open_recording
from pipeline.recordings.base import Recording
from pipeline.visual_motion import PATIENCE, VisualMotion
from stereo.pair import StereoPair
from stereo.pose import Pose
from stereo.visual_odometry import Sighting
from stereo.visual_settings import VisualSettings

EXACT = VisualSettings(
    along=0.0, across=0.0, heading=0.0
)  # a rendered rig is calibrated without error
SECOND = 1_000_000_000


@pytest.fixture(scope="module")
def recording(office_piece) -> Recording:
    return open_recording(office_piece)


@pytest.fixture(scope="module")
def pairs(recording) -> list[StereoPair]:
    return [files.load() for files in recording.pairs]


@pytest.fixture
def visual(recording) -> VisualMotion:
    return VisualMotion(recording.rig, EXACT, seed=1)


def drive(motion: VisualMotion | FusedMotion, pairs: list[StereoPair]) -> list[Motion | None]:
    return [motion.step(pair.stamp, motion.prepare(pair)) for pair in pairs]


def true_motion(recording: Recording, motion: Motion) -> np.ndarray:
    assert recording.poses is not None
    places = dict(zip(recording.poses.stamps.tolist(), recording.poses.poses, strict=True))
    return compose(inverse(places[motion.first]), places[motion.last])


def dark(pair: StereoPair) -> StereoPair:
    return StereoPair(pair.stamp, np.full_like(pair.left, 8), np.full_like(pair.right, 8))


def test_a_drive_is_known_within_its_covariance(recording, pairs):
    """By default settings, single steps and five together: NEES within a factor of 1.5."""
    visual = VisualMotion(recording.rig, VisualSettings(), seed=1)
    first, *motions = [motion for motion in drive(visual, pairs) if motion is not None]
    assert not first.increment.any()
    assert len(motions) == len(pairs) - 1
    for count in (1, 5):
        squared = []
        for span in zip(*(motions[k:] for k in range(count)), strict=False):
            whole = functools.reduce(Motion.then, span)
            error = whole.increment - true_motion(recording, whole)
            squared.append(error @ np.linalg.solve(whole.covariance, error))
        assert 2.0 < np.mean(squared) < 4.5
    path = functools.reduce(Motion.then, motions)
    error = path.increment - true_motion(recording, path)
    assert np.hypot(*error[:2]) < 0.01 * 6.4  # of 6.4 m
    assert abs(error[2]) < np.radians(0.5)
    report = visual.report()
    assert report["visual_pairs"] == len(motions)
    assert report["visual_lost_pairs"] == 0
    assert report["visual_inliers_median"] > 100
    assert told(visual, first.first) == []


def test_a_robot_that_stands_still_does_not_drift(visual, pairs):
    chance = np.random.default_rng(1)

    def again(stamp: int) -> StereoPair:
        left, right = (
            np.clip(image + 2.0 * chance.standard_normal(image.shape), 0, 255).astype(np.uint8)
            for image in (pairs[5].left, pairs[5].right)
        )
        return StereoPair(stamp, left, right)

    motions = drive(visual, [again(step * SECOND // 10) for step in range(40)])
    total = Motion.none(0)
    for motion in motions:
        assert motion is not None
        total = total.then(motion)
    assert np.abs(total.increment).max() < 2e-3
    assert np.count_nonzero([motion.increment.any() for motion in motions if motion]) < 8
    assert visual.report()["visual_key_frames"] == 1


class Creeping:
    """Visual odometry of a robot that moves by 2 mm a pair, seen with sigma 5 mm, 0.3 deg."""

    noise = np.diag([0.005, 0.005, np.radians(0.3)]) ** 2

    def __init__(self, renew: int, speed: float = 0.002) -> None:
        self._chance, self._renew, self._speed = np.random.default_rng(3), renew, speed
        self._pairs = 0

    def start(self, _) -> bool:
        return True

    def see(self, *_) -> Sighting:
        self._pairs += 1
        place, turn = self._chance.multivariate_normal(np.zeros(3), self.noise)[[0, 2]]
        c, s = np.cos(turn), np.sin(turn)
        R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        t = np.array([self._speed * self._pairs + place, 0.0, 0.0])
        renewed = self._pairs == self._renew
        self._pairs %= self._renew
        pose = Pose(R, t, 1.1 * self.noise, self.noise, np.ones(50, bool), 0.2)
        return Sighting(pose, 50, renewed)


@pytest.mark.parametrize("renew", [7, 60])
def test_a_robot_that_creeps_is_not_held_for_ever(visual, pairs, renew):
    visual._odometry = Creeping(renew)
    pyramids = visual.prepare(pairs[0])
    motions = [visual.step(step * SECOND // 10, pyramids) for step in range(421)]
    total, held = Motion.none(0), 0
    for motion in motions[1:]:
        assert motion is not None
        total = total.then(motion)
        held += not motion.increment.any()
        # Standing is no certainty: the step that was held back is within the covariance.
        assert np.linalg.eigvalsh(motion.covariance).min() > 0.0
    assert held > 50
    error = total.increment - (0.84, 0.0, 0.0)
    assert error @ np.linalg.solve(total.covariance, error) < 11.3
    assert abs(error[0]) < 0.1


def test_what_is_held_back_is_within_the_covariance(visual, pairs):
    """25 mm seen with a standard deviation of 10 mm are no motion, but not none for certain."""
    visual._odometry = Creeping(10_000, speed=0.0)
    pyramids = visual.prepare(pairs[0])
    visual.step(0, pyramids)
    sums = np.zeros((3, 3))
    for step in range(1, 3000):
        motion = visual.step(step * SECOND // 10, pyramids)
        assert motion is not None
        sums += motion.covariance
        seen = visual.sighting.pose.planar
        if not motion.increment.any():
            assert seen @ np.linalg.solve(sums, seen) < 1.01
    # Five minutes of standing are hardly more uncertain than a moment.
    assert np.sqrt(sums[0, 0]) < 0.08


def test_a_dark_moment_is_bridged(visual, recording, pairs):
    shown = [*pairs[:4], dark(pairs[4]), *pairs[5:8]]
    motions = drive(visual, shown)
    assert motions[4] is None
    spanning = motions[5]
    assert spanning is not None
    assert (spanning.first, spanning.last) == (pairs[3].stamp, pairs[5].stamp)
    assert spanning.increment == pytest.approx(true_motion(recording, spanning), abs=0.02)
    (found,) = told(visual, pairs[0].stamp)
    assert "lost its way once (1.5 to 2.5 s, found again)" in found.line


def test_where_nothing_is_seen_for_long_the_motion_is_a_doubtful_guess(visual, recording, pairs):
    shown = [*pairs[:4], *(dark(pair) for pair in pairs[4:14]), *pairs[24:28]]
    motions = drive(visual, shown)
    assert motions[4:14] == [None] * 10
    guess = motions[14]
    assert guess is not None
    assert guess.last - guess.first > PATIENCE
    error = guess.increment - true_motion(recording, guess)
    assert error @ np.linalg.solve(guess.covariance, error) < 50.0
    assert np.sqrt(np.diag(guess.covariance)).min() > 0.3
    after = motions[15]
    assert after is not None
    assert after.increment == pytest.approx(true_motion(recording, after), abs=0.01)
    assert visual.report()["visual_guesses"] == 1
    (found,) = told(visual, pairs[0].stamp)
    assert "guessed" in found.line
    assert "more light" in found.line


def test_someone_who_walks_by_is_not_taken_for_motion(visual, pairs):
    """A textured thing over nearly half of the view moves while the robot stands."""
    chance = np.random.default_rng(2)
    coat = np.kron(chance.integers(0, 255, (60, 28)), np.ones((4, 5))).astype(np.uint8)

    def passed(step: int) -> StereoPair:
        left, right = pairs[0].left.copy(), pairs[0].right.copy()
        x = 20 + 12 * step
        left[:, x : x + 140], right[:, x - 15 : x + 125] = coat, coat
        return StereoPair(step * SECOND // 10, left, right)

    for motion in drive(visual, [passed(step) for step in range(12)]):
        assert motion is not None
        assert np.abs(motion.increment).max() < 0.01


class Wheels:
    """Wheels that tell the truth with a little doubt, but slip or fall silent when told to."""

    def __init__(self, recording: Recording, slips: dict[int, np.ndarray], silent: set[int]):
        self._recording, self._slips, self._silent = recording, slips, silent
        self._stamps = [files.stamp for files in recording.pairs]
        self._previous: int | None = None

    def until(self, stamp: int) -> Motion | None:
        step = self._stamps.index(stamp)
        if step in self._silent:
            return None
        previous, self._previous = self._previous, stamp
        if previous is None:
            return Motion.none(stamp)
        covariance = np.diag([0.01, 0.005, 0.01]) ** 2
        true = true_motion(self._recording, Motion(np.zeros(3), covariance, previous, stamp))
        slip = self._slips.get(step, np.zeros(3))
        return Motion(true + slip, covariance, previous, stamp)

    def report(self) -> dict[str, int | float]:
        return {}


def fused(recording, slips=None, silent=()) -> FusedMotion:
    visual = VisualMotion(recording.rig, EXACT, seed=1, hold=False)
    return FusedMotion(visual, Wheels(recording, slips or {}, set(silent)), max_speed=1.5)


def test_a_slipping_wheel_is_found_out_and_told(recording, pairs):
    both = fused(recording, {6: np.array([0.2, 0.0, 0.3]), 7: np.array([0.2, 0.0, 0.3])})
    motions = drive(both, pairs[:12])
    for motion in motions[1:]:
        assert motion is not None
        assert motion.increment == pytest.approx(true_motion(recording, motion), abs=0.01)
    assert [(slip.first, slip.last) for slip in both.slips] == [(pairs[5].stamp, pairs[7].stamp)]
    (found,) = told(both, pairs[0].stamp)
    assert found.text.startswith("wheels slipped once (2.5 to 3.5 s, 0.4")
    assert both.report()["slips"] == 1


def test_wheels_answer_alone_where_nothing_is_seen(recording, pairs):
    both = fused(recording)
    shown = [*pairs[:4], *(dark(pair) for pair in pairs[4:14]), *pairs[14:20]]
    for motion in drive(both, shown)[1:]:
        assert motion is not None
        assert motion.increment == pytest.approx(true_motion(recording, motion), abs=0.01)
    report = both.report()
    assert report["steps_wheels_alone"] >= 10
    assert report["steps_fused"] >= 6
    assert "the wheels answered alone" in told(both, pairs[0].stamp)[0].text


def test_images_answer_alone_where_the_wheels_are_silent(recording, pairs):
    both = fused(recording, silent=range(4, 8))
    motions = drive(both, pairs[:12])
    for motion in motions[1:]:
        assert motion is not None
        assert motion.increment == pytest.approx(true_motion(recording, motion), abs=0.01)
    assert [(m.first, m.last) for m in motions[1:] if m] == [
        (a.stamp, b.stamp) for a, b in itertools.pairwise(pairs[:12])
    ]
    assert both.report()["steps_images_alone"] == 4
    assert both.report()["steps_fused"] == 7


def test_where_neither_knows_the_next_motion_spans_it(recording, pairs):
    both = fused(recording, silent=[4, 5])
    shown = [*pairs[:4], dark(pairs[4]), dark(pairs[5]), *pairs[6:9]]
    motions = drive(both, shown)
    assert motions[4] is None
    assert motions[5] is None
    assert motions[6] is not None
    assert motions[6].first == pairs[3].stamp
    assert motions[6].increment == pytest.approx(true_motion(recording, motions[6]), abs=0.02)


def test_an_unreadable_pair_is_no_motion_from_images(visual, pairs):
    assert visual.step(pairs[0].stamp, None) is None
    assert drive(visual, pairs[1:3])[1] is not None
