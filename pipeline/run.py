"""The main job: a recording becomes a map and a path. (Scan logs: `run_log.py`.)"""

from __future__ import annotations

import math
import time
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, TypeVar

from calibration.rig import StereoRig
from mapping.gate import ObservationGate
from mapping.known_map import KnownMap
from mapping.mapper import HierarchicalMapper
from mapping.odometry_witness import OdometryWitness
from odometry.motion import Motion
from pipeline.checkpoint import NOTHING, Observations
from pipeline.errors import InputError
from pipeline.frontend import UNREADABLE, Observation, ahead, observe
from pipeline.health.finding import Finding
from pipeline.health.image_findings import REMEDIES
from pipeline.image_check import check_images
from pipeline.key_frames import KeyFrame, KeyFrames
from pipeline.motion_told import told
from pipeline.places import Place
from pipeline.recordings.base import Pair, Recording
from pipeline.seeing import AnyMotion, LoadedPair, moved
from pipeline.settings import Settings
from pipeline.watcher import NOBODY, Moment, Watcher
from pipeline.worst_pairs import WorstPairs
from stereo.ranger import StereoRanger
from stereo.scan import RangeScan

# A key frame of the point cloud is taken after this travel [m] or turn [rad].
KEY_FRAME_SPACING = (0.5, math.radians(30.0))
# Ranges are used while their standard deviation stays below so many cells of the map.
USABLE_CELLS = 2.0

T = TypeVar("T")

Progress = Callable[[int, int], None]
Interrupted = Callable[[], bool]


@dataclass
class MapRun:
    """All that a run found out; `pipeline.results` writes it down.

    unit: what the input consists of; key_frames: None where there are no images; brightness: of
    each observation, the left image over the right one; told: what the motion's source has to say;
    ends: the numbers of the poses at which local maps closed; worst: the pairs to look at;
    witness: of odometry's errors; places: marked by somebody who watched; earlier_places: of an
    earlier run into the same folder, and of the map to begin in.
    """

    mapper: HierarchicalMapper
    unit: str = "pairs"
    key_frames: KeyFrames | None = field(default_factory=KeyFrames)
    counts: Counter[str] = field(default_factory=Counter)
    skipped: dict[str, list[str]] = field(default_factory=dict)
    brightness: list[float] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=lambda: defaultdict(float))
    told: list[Finding] = field(default_factory=list)
    ends: list[int] = field(default_factory=list)
    worst: WorstPairs = field(default_factory=WorstPairs)
    witness: OdometryWitness = field(init=False)
    places: list[Place] = field(default_factory=list)
    earlier_places: list[dict[str, Any]] = field(default_factory=list)
    partial: bool = False

    def __post_init__(self) -> None:
        self.witness = OdometryWitness(self.mapper.settings)

    @property
    def used(self) -> int:
        """Pairs or scans that got a pose."""
        return self.counts[f"{self.unit} used"]

    def move(self, motion: Motion) -> None:
        """The robot moved to where the next pair or scan was taken."""
        self.counts[f"{self.unit} used"] += 1
        self.mapper.move(motion)
        self.witness.move(motion)

    def observe(self, scan: RangeScan, name: str) -> None:
        """What was seen where the robot moved to."""
        self.counts["observations"] += 1
        index, steps = len(self.mapper.stamps) - 1, self.mapper.filter.health
        before = len(steps)
        self.mapper.observe(scan)
        self.witness.observe(scan)
        self.worst.observed(index, name, scan, steps[before:])
        self.ends += [index] * (len(steps) - before)

    def each(
        self, items: Iterable[T], total: int, progress: Progress, interrupted: Interrupted
    ) -> Iterator[T]:
        """The items one by one; what is done between two of them counts as time of mapping.

        progress(done, total) is told after every one; when `interrupted()` turns true the run
        ends there, marked partial.
        """
        for done, item in enumerate(items, start=1):
            if interrupted():
                self.partial = True
                return
            start = time.perf_counter()
            yield item
            self.seconds["mapping"] += time.perf_counter() - start
            progress(done, total)


@dataclass(frozen=True)
class Step:
    """One pair on its way: how the robot came there, and what is wanted of it."""

    pair: Pair
    motion: Motion | None
    due: bool = False
    key_frame: bool = False


def map_recording(
    recording: Recording,
    rig: StereoRig,
    motion: AnyMotion,
    settings: Settings,
    seed: int = 0,
    threads: int = 1,
    progress: Progress = lambda done, total: None,
    interrupted: Interrupted = lambda: False,
    known: Observations = NOTHING,
    begin: KnownMap | None = None,
    watcher: Watcher = NOBODY,
) -> MapRun:
    """Map a recording; `progress` and `interrupted` as in `MapRun.each`.

    known: what was seen in a run before, which need not be looked at again. begin: a map to go on
    in. watcher: is shown how the run goes, images included.

    Raises:
        InputError: images and rig do not fit, or no pair can be used.
        StereoError: the images are exchanged, or the rig makes no stereo.
        MappingError: the place in the map to begin in cannot be found.
    """
    ranger = make_ranger(rig, settings)
    check_images(recording, rig, ranger)
    mapper = HierarchicalMapper(settings.mapping, seed, begin)
    run = MapRun(mapper)
    watcher.begins(run, ranger)

    total = len(recording.pairs)
    looks = look(recording, ranger, mapper.gate, motion, threads, known, watcher is not NOBODY)
    for step, seen in run.each(looks, total, progress, interrupted):
        if seen is not None:
            known.add(step.pair.stamp, seen)
        take(step, seen, run)
        show(step, seen, run, watcher)
    if not run.counts["observations"] and not run.partial:
        raise InputError(f"{recording.path}: none of {total} pairs could be used: {_why(run)}")
    mapper.finish()
    run.told = told(motion, recording.pairs[0].stamp)
    return run


def look(
    recording: Recording,
    ranger: StereoRanger,
    gate: ObservationGate,
    motion: AnyMotion,
    threads: int,
    known: Observations = NOTHING,
    keep: bool = False,
) -> Iterator[tuple[Step, Observation | None]]:
    """Every pair on its way, and what is seen in it where it is due: all that a mapper is given.

    known: as of `map_recording`. keep: images and disparities are passed on, too.
    """

    def work(step: Step) -> Observation | None:
        if not step.due:
            return None
        return known.get(step.pair.stamp) or observe(step.pair, ranger, step.key_frame, keep)

    stepper = Stepper(gate)
    with_motion = moved(recording.pairs, motion, threads)
    yield from ahead((stepper.step(pair, m) for pair, m in with_motion), work, threads)


class Stepper:
    """Tells of every pair what is wanted of it.

    Motion is known before a pair is matched, and mostly before it is read: due pairs only.
    """

    def __init__(self, gate: ObservationGate) -> None:
        self._gate = gate
        self._key_gate = ObservationGate(*KEY_FRAME_SPACING)
        self._since = Motion.none(0)

    def step(self, pair: Pair, motion: Motion | None) -> Step:
        """The next pair, in order of time, and the motion since the last that had any."""
        if motion is None:
            return Step(pair, None)
        due = self._gate.step(motion.increment)
        self._since = self._since.then(motion)
        key_frame = due and self._key_gate.step(self._since.increment)
        if due:
            self._since = Motion.none(pair.stamp)
        return Step(pair, motion, due, key_frame)


def take(step: Step, seen: Observation | None, run: MapRun) -> None:
    """Let the run have a pair, and what was seen in it where it was due."""
    if step.motion is None and isinstance(step.pair, LoadedPair) and step.pair.damage:
        _skip(run, step.pair, UNREADABLE, step.pair.damage)
        return
    if step.motion is None:
        run.counts["pairs without motion"] += 1
        run.skipped.setdefault("pair without motion", []).append(str(step.pair.stamp))
        return
    run.move(step.motion)
    if seen is None:
        return
    run.seconds["reading"] += seen.seconds_reading
    run.seconds["stereo"] += seen.seconds_stereo
    if seen.scan is None:
        _skip(run, step.pair, seen.kind, seen.damage)
        return
    run.brightness.append(seen.brightness)
    run.observe(seen.scan, step.pair.name)
    if run.key_frames is not None and seen.points is not None and seen.colours is not None:
        run.key_frames.append(KeyFrame(len(run.mapper.stamps) - 1, seen.points, seen.colours))


def show(step: Step, seen: Observation | None, run: MapRun, watcher: Watcher) -> None:
    """Show a watcher what `take` made of a pair, where it has a pose."""
    if step.motion is not None:
        mapper = run.mapper
        maps = len(mapper.filter.health)
        watcher.mapped(Moment(step.pair.stamp, step.pair, seen, mapper.pose, maps))


def _skip(run: MapRun, pair: Pair, kind: str, damage: str) -> None:
    run.counts[f"{UNREADABLE}s" if kind == UNREADABLE else "useless pairs"] += 1
    run.skipped.setdefault(kind, []).append(damage)
    run.worst.skipped(len(run.mapper.stamps) - 1, pair.stamp, pair.name, kind, damage)


def make_ranger(rig: StereoRig, settings: Settings) -> StereoRanger:
    """The stereo stage for ranges of use to the map."""
    return StereoRanger(
        rig,
        settings.stereo,
        settings.mapping.max_range,
        usable_sigma=USABLE_CELLS * settings.mapping.cell,
    )


def _why(run: MapRun) -> str:
    if run.skipped:
        kind, names = max(run.skipped.items(), key=lambda item: len(item[1]))
        if kind == UNREADABLE:
            return f"{len(names)} unreadable, e.g. {names[0]}"
        if kind in REMEDIES:
            return f"{kind} in {len(names)}, e.g. {names[0]}: {REMEDIES[kind]}"
    return "the motion source knows nothing about the time of the images (compare the stamps)"
