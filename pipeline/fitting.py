"""Settings that the input decides where the user does not: the cells' size, the body's."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import msgspec
import numpy as np

from calibration.rig import StereoRig
from mapping.gate import SLACK
from odometry.encoders import EncoderParameters, encoder_parameters
from odometry.errors import OdometryError
from pipeline.motion import LOOKING, motion_of, usual_motion
from pipeline.recordings.base import Recording
from pipeline.run import USABLE_CELLS
from pipeline.seeing import moved
from pipeline.settings import Settings
from stereo.disparity import choose_disparities
from stereo.ranger import usable_range

if TYPE_CHECKING:
    from mapping.known_map import KnownMap

CELLS = (0.05, 0.1, 0.2, 0.5, 1.0)  # m
SAMPLES = 5  # places in a recording at which its speed is looked at
OF_MAP = "the cells of the map in which the run begins"
CRUISING = 0.75  # quantile of these: a vehicle may wait at some of them


def fitted(
    settings: Settings,
    is_cell_open: bool,
    recording: Recording,
    rig: StereoRig,
    motion: str | None,
    seed: int,
    begin: KnownMap | None,
) -> tuple[Settings, dict[str, str]]:
    """The settings with what nobody has set, and the reasons, by setting.

    Raises:
        InputError: the motion is none, or the recording does not hold it.
    """
    mapping, why = settings.mapping, {}
    if is_cell_open:
        if begin is not None:
            cell, reason = begin.grid.cell, OF_MAP
        elif recording.cell is not None:
            cell, reason = recording.cell, "as it was mapped when it was recorded"
        else:
            way = travel_between_pairs(recording, rig, motion, settings, seed)
            cell, reason = fitting_cell(rig, settings, way)
        mapping = msgspec.structs.replace(mapping, cell=cell)
        why["mapping.cell"] = f"{cell:g} m: {reason}"
    settings = msgspec.structs.replace(settings, mapping=mapping)
    return with_body(settings, rig, recording.encoders), why


def fitted_live(
    settings: Settings,
    is_cell_open: bool,
    rig: StereoRig,
    wheels: EncoderParameters | None,
    begin: KnownMap | None,
) -> tuple[Settings, dict[str, str]]:
    """As `fitted`, before anything is recorded. The recording keeps the choice, so that mapping it
    again gives the same map."""
    mapping, why = settings.mapping, {}
    if is_cell_open:
        cell, reason = CELLS[0], "the usual size: how fast the robot will be is not known"
        if begin is not None:
            cell, reason = begin.grid.cell, OF_MAP
        mapping = msgspec.structs.replace(mapping, cell=cell)
        why["mapping.cell"] = f"{cell:g} m: {reason}"
    settings = msgspec.structs.replace(settings, mapping=mapping)
    return with_body(settings, rig, wheels), why


def fitting_cell(rig: StereoRig, settings: Settings, travel: float | None) -> tuple[float, str]:
    """The cells' side [m] for a rig that travels so far from pair to pair [m], and why.

    A range is used up to where its standard deviation is USABLE_CELLS, so that larger cells see
    farther. What enters the view while a local map is made must still be there at its end, or the
    next one shows nothing that the map holds already: the smallest cells with which the distances
    that the camera measures span the way of a local map.
    """
    mapping, stereo = settings.mapping, settings.stereo
    if travel is None:
        return CELLS[0], "the usual size: how far the robot goes from pair to pair is not known"
    if SLACK * travel <= mapping.spacing:
        return CELLS[0], f"{travel:.2f} m from pair to pair, no more than mapping.spacing"
    factor = rig.left.fx * rig.baseline
    searched = choose_disparities(rig.left.fx, rig.baseline, rig.image_size[0])
    near = factor / (stereo.disparities or searched)
    way = mapping.window * travel

    def far(cell: float) -> float:
        usable = usable_range(factor, stereo.noise, USABLE_CELLS * cell)
        return min(usable, mapping.max_range or math.inf)

    # Where max_range is what ends the view, larger cells show no more.
    otherwise = CELLS[-1] if mapping.max_range is None else CELLS[0]
    cell = next((c for c in CELLS if far(c) - near >= way), otherwise)
    reason = (
        f"{travel:.2f} m from pair to pair, {way:.1f} m in a local map, ranges from {near:.1f} to "
        f"{far(cell):.1f} m known to {USABLE_CELLS:g} cells"
    )
    if cell > CELLS[0]:
        smaller = CELLS[CELLS.index(cell) - 1]
        reason += f" (with {smaller:g} m up to {far(smaller):.1f} m, too short a view)"
    return cell, reason


def travel_between_pairs(
    recording: Recording, rig: StereoRig, motion: str | None, settings: Settings, seed: int
) -> float | None:
    """How far the robot goes from pair to pair when it drives [m]; None: nothing tells."""
    choice = motion or usual_motion(recording, rig, settings.odometry)[0]
    if choice in LOOKING and (recording.ticks is not None or recording.odometry is not None):
        choice = "odometry" if recording.ticks is None else "encoders"
    pairs = recording.pairs
    firsts = np.linspace(0, max(len(pairs) - 2, 0), SAMPLES).round().astype(int)
    steps = []
    for first in np.unique(firsts).tolist() if len(pairs) > 1 else []:
        source = motion_of(choice, recording, rig, settings, seed)
        _, step = (found for _, found in moved(pairs[first : first + 2], source, threads=1))
        if step is not None:
            steps.append(math.hypot(*step.increment[:2]))
    return float(np.quantile(steps, CRUISING)) if steps else None


def with_body(settings: Settings, rig: StereoRig, wheels: EncoderParameters | None) -> Settings:
    """With a footprint, where none is set, as wide as the track of the rig's wheels, else of those
    that were recorded with it."""
    if settings.mapping.footprint is not None:
        return settings
    try:
        if "encoders" in rig.sections:
            wheels = encoder_parameters(rig.sections["encoders"], "rig: encoders")
    except OdometryError:
        return settings  # whoever needs the wheels says what is wrong
    if wheels is None:
        return settings
    mapping = msgspec.structs.replace(settings.mapping, footprint=0.5 * wheels.track)
    return msgspec.structs.replace(settings, mapping=mapping)
