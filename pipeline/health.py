"""What a run says of itself: a few plain lines that tell a user what to do.

Was the filter healthy, did the local maps match, was there enough to see, and does odometry
over- or underestimate distance or rotation against the matched motion.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mapping.mapper import HierarchicalMapper
from mapping.particle_filter import FilterHealth
from mapping.path import travelled
from odometry.motion import compose, inverse
from pipeline.frontend import UNREADABLE
from stereo.pair_check import BLACK, LEFT_COVERED, RIGHT_COVERED, SAME, SATURATED

# A step in which fewer than this share of the particles carry the weight has lost most of them;
# one after a loop closed is the filter at work, many are a filter that is starved.
STARVED = 0.05
OFTEN = 0.25
# A step that matches less than half of the obstacles in view disagrees with its own map. Of 16
# simulated runs by both methods, those within 0.2 m of the truth had at most 1.6 % of such steps,
# those more than 0.3 m off 3.8 % and more.
HALF = 0.5
SELDOM = 0.02
ANSWERED_WELL = 0.6

# Ends of lines that ask for nothing, though they say what was looked for.
FINE = (": healthy", ": good")
NOT_USED = "could not be used"

# Cameras whose images differ more in brightness are not set alike; what they see differs less.
UNEQUAL = 1.5
REMEDIES = {
    BLACK: "take off the lens caps, or give more light or exposure",
    SATURATED: "lower the exposure or the gain, or keep the cameras out of the light",
    LEFT_COVERED: "uncover or clean its lens, check its cable",
    RIGHT_COVERED: "uncover or clean its lens, check its cable",
    SAME: "one camera was recorded twice: give the other one's images",
}

# Odometry and path are compared over stretches of this travel [m], turns included.
STRETCH = 1.0
# How far they part is told from more than FEW of them, systematic errors from more than LEAST,
# with standard errors from so many blocks of neighbours, whose errors hang together.
FEW_STRETCHES = 5
LEAST_STRETCHES = 60
BLOCKS = 20
SIGNIFICANT = 3.0  # standard errors
# A smaller error is not worth a word: share, share, rad/m.
WORTH_TELLING = np.array([0.01, 0.01, math.radians(0.1)])
OUTLIER = 4.0  # robust standard deviations


def health_lines(
    mapper: HierarchicalMapper, sight: str, encoders: bool, images: bool = False
) -> list[str]:
    """The lines of a finished run.

    sight: "columns" of a camera or "beams" of a laser; encoders: the odometry is ours to
    calibrate; images: it comes from the images, or from both.
    """
    steps = mapper.filter.health
    if not steps:
        return ["nothing was mapped: the robot saw nothing, or the run was too short"]
    errors = odometry_errors(np.array(mapper.odometry), mapper.path())
    return [
        particles_line(steps, mapper.settings.particles),
        matching_line(steps),
        answers_line(steps, sight),
        *agreement_lines(np.array(mapper.odometry), mapper.path()),
        *odometry_lines(errors, encoders, images),
    ]


def particles_line(steps: Sequence[FilterHealth], particles: int) -> str:
    """Did enough particles carry the weight, and how often were they resampled."""
    shares = np.array([step.n_eff for step in steps]) / particles
    resampled = sum(step.resampled for step in steps)
    line = (
        f"N_eff {np.median(shares):.0%} of {particles} particles (least {shares.min():.0%}), "
        f"resampled in {resampled} of {len(steps)} steps: "
    )
    if np.mean(shares < STARVED) <= OFTEN:
        return line + "healthy"
    return line + (
        "too few particles agree with what is seen: give more (mapping.particles), or more doubt "
        "of odometry (odometry.along, odometry.heading)"
    )


def matching_line(steps: Sequence[FilterHealth]) -> str:
    """How much of what the map holds in view was seen again."""
    matched = np.array([step.matched for step in steps if step.judged])
    judged = f"{len(matched)} of {len(steps)} steps saw enough of the map to be judged"
    if not len(matched):
        return (
            f"{judged}: the path is odometry's own: let the robot look at places again, or lower "
            "mapping.min_overlap"
        )
    line = f"{judged}; they matched {np.median(matched):.0%} of its obstacles in view"
    poor = int(np.count_nonzero(matched < HALF))
    if poor <= SELDOM * len(matched):
        return f"{line}: good"
    return (
        f"{line}, {poor} of them less than half: the map disagrees with itself there: look for "
        "double walls in map.png; more particles, another --seed or a better odometry may close "
        "the loop"
    )


def answers_line(steps: Sequence[FilterHealth], sight: str) -> str:
    """Share of columns or beams without an answer."""
    observations = np.array([step.observations for step in steps])
    answered = float(np.average([step.answered for step in steps], weights=observations))
    line = f"{1.0 - answered:.0%} of the {sight} had no answer"
    if answered >= ANSWERED_WELL:
        return line
    if sight == "columns":
        return f"{line}: more light or texture, a cleaner lens, or a new calibration would help"
    return f"{line}: where maximum readings mean open space, set laser.maximum=free"


def image_lines(skipped: Mapping[str, Sequence[str]], brightness: Sequence[float]) -> list[str]:
    """What was wrong with the images, and its remedy; nothing where all were in order.

    skipped: names of pairs that were passed over, by reason; brightness: of the left image over
    the right one, for each observation.
    """
    lines = []
    for reason, names in skipped.items():
        if reason in REMEDIES:
            lines.append(f"{reason} in {_pairs(names)} (e.g. {names[0]}): {REMEDIES[reason]}")
        elif reason == UNREADABLE:
            lines.append(f"{_pairs(names)} {NOT_USED}, e.g. {names[0]}")
    ratio = float(np.median(brightness)) if len(brightness) else 1.0
    if max(ratio, 1.0 / ratio) > UNEQUAL:
        side, times = ("left", ratio) if ratio > 1.0 else ("right", 1.0 / ratio)
        lines.append(
            f"the {side} images are {times:.1f} times as bright as the others: give both cameras "
            "the same exposure and gain"
        )
    return lines


@dataclass(frozen=True)
class OdometryErrors:
    """What odometry does wrong throughout, (3,) each with its standard error.

    distance and rotation: what it makes of one, less one (+0.02 = 2 % too much); drift: turn to
    the left that it reports without there being one [rad per metre].
    """

    value: np.ndarray
    error: np.ndarray

    @property
    def significant(self) -> np.ndarray:
        """Which of the three are beyond doubt, and worth a word, (3,) bool."""
        size = np.abs(self.value)
        return (size > SIGNIFICANT * self.error) & (size > WORTH_TELLING)


def odometry_errors(odometry: np.ndarray, path: np.ndarray) -> OdometryErrors | None:
    """Systematic errors of odometry, poses (n, 3), against the matched path, poses (n, 3).

    Motion is compared over stretches of `STRETCH`. Odometry is regressed on the matched motion,
    not the other way about: the noise of the regressor pulls the slope towards zero, and odometry
    is the noisier of the two. Standard errors by the jackknife over blocks of neighbours. What is
    found is rather too small than too large: odometry's own claim holds the path back.

    None: the run was too short to tell, or the robot never drove or never turned.
    """
    if not len(odometry):
        return None
    way = travelled(odometry)
    ends = np.unique(np.searchsorted(way, np.arange(0.0, way[-1], STRETCH)))
    if len(ends) <= LEAST_STRETCHES:
        return None
    found, true = (_stretches(poses, ends) for poses in (odometry, path))
    travel = np.hypot(true[:, 0], true[:, 1])
    if not (travel.any() and true[:, 2].any()):
        return None
    along = np.sum(found[:, :2] * true[:, :2], axis=1) / np.where(travel > 0, travel, 1.0)
    distance = travel[:, None], along
    turning = np.stack([true[:, 2], travel], axis=1), found[:, 2]

    def fit(rows: np.ndarray) -> np.ndarray:
        slopes = [np.linalg.lstsq(A[rows], b[rows], rcond=None)[0] for A, b in (distance, turning)]
        return np.concatenate(slopes) - (1.0, 1.0, 0.0)

    rows = np.flatnonzero(_inliers(*distance) & _inliers(*turning))
    blocks = np.array_split(rows, BLOCKS)
    without = np.array([fit(np.setdiff1d(rows, block)) for block in blocks])
    spread = np.sum((without - without.mean(axis=0)) ** 2, axis=0)
    return OdometryErrors(fit(rows), np.sqrt((BLOCKS - 1) / BLOCKS * spread))


def _stretches(poses: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Motion (m - 1, 3) between the poses numbered `ends` (m,); turns are not wrapped."""
    motion = compose(inverse(poses[ends[:-1]]), poses[ends[1:]])
    motion[:, 2] = np.diff(np.unwrap(poses[:, 2])[ends])
    return motion


def _inliers(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Which rows of A x = b are not far off the rest: wheel slip and false matches are."""
    residual = b - A @ np.linalg.lstsq(A, b, rcond=None)[0]
    off = np.abs(residual - np.median(residual))
    # 1.4826 median absolute deviations are one standard deviation of a normal distribution.
    scale = 1.4826 * float(np.median(off))
    return off <= OUTLIER * scale + 1e-9


def agreement_lines(odometry: np.ndarray, path: np.ndarray) -> list[str]:
    """How far odometry and the matched path, poses (n, 3), part over stretches of `STRETCH`."""
    way = travelled(odometry)
    ends = np.unique(np.searchsorted(way, np.arange(0.0, way[-1], STRETCH)))
    if len(ends) <= FEW_STRETCHES:
        return []
    found, true = (_stretches(poses, ends) for poses in (odometry, path))
    apart = np.median(np.hypot(*(found - true)[:, :2].T))
    turned = np.degrees(np.median(np.abs(found[:, 2] - true[:, 2])))
    return [
        f"odometry and matched path part by {1000 * apart:.0f} mm and {turned:.1f} deg "
        f"in {STRETCH:g} m (median of {len(ends) - 1} stretches)"
    ]


def odometry_lines(
    errors: OdometryErrors | None, encoders: bool, images: bool = False
) -> list[str]:
    """What odometry does wrong, and its remedy; nothing where nothing is certain."""
    if errors is None or not errors.significant.any():
        return []
    (distance, rotation, drift), (d_error, r_error, t_error) = errors.value, errors.error
    told = errors.significant
    lines = []
    if told[0]:
        line = f"odometry {_estimates(distance)} distance by {_percent(distance, d_error)}"
        factor = 1.0 / (1.0 + distance)
        remedy = f": multiply left_radius and right_radius of the encoders by {factor:.3f}"
        lines.append(line + (remedy if encoders else ""))
    if told[1]:
        line = f"odometry {_estimates(rotation)} rotation by {_percent(rotation, r_error)}"
        # Corrected radii change the rotation, too.
        factor = (1.0 + rotation) / (1.0 + (distance if told[0] else 0.0))
        remedy = f": multiply the track of the encoders by {factor:.3f}"
        lines.append(line + (remedy if encoders else ""))
    if told[2]:
        side = "left" if drift > 0 else "right"
        larger = "right" if drift > 0 else "left"
        line = (
            f"odometry turns to the {side} by {abs(math.degrees(drift)):.2f} ± "
            f"{math.degrees(t_error):.2f} deg a metre where the robot does not"
        )
        lines.append(line + (f": {larger}_radius of the encoders is too large" if encoders else ""))
    if images:
        lines[-1] += ": calibrate the cameras, or doubt them more (visual.along, visual.heading)"
    elif not encoders:
        lines[-1] += ": calibrate the robot's odometry, or doubt it more (odometry.heading, .along)"
    return lines


def complaints(lines: Sequence[str]) -> list[str]:
    """Those of a run's health lines that ask for something."""
    return [
        line for line in lines if (": " in line and not line.endswith(FINE)) or NOT_USED in line
    ]


def _pairs(names: Sequence[str]) -> str:
    return "1 pair" if len(names) == 1 else f"{len(names)} pairs"


def _estimates(error: float) -> str:
    return "overestimates" if error > 0 else "underestimates"


def _percent(value: float, error: float) -> str:
    return f"{100 * abs(value):.1f} ± {100 * error:.1f} %"
