"""What the ranges of a scan should have been: beside a rendered recording, or from a finished map.

A map and path made from the same images know the false matches, which it filtered out, but share
part of the scans' noise and add their own: half a cell, and the error of the path.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from mapping.grid import OCCUPIED, OccupancyGrid
from odometry.motion import compose
from pipeline.errors import InputError
from pipeline.map_files import read_map
from pipeline.recordings.base import Recording
from pipeline.trajectory import read_tum
from simulation.grid_caster import cast
from simulation.true_scans import TrueScans, load_true_scans
from stereo.scan import RangeScan

SCANS = Path("truth") / "scans.npz"
# Walls come out of the map so thick, along a beam [cells].
THICKEST = 4.0
SAME_BEARING = 1e-4  # rad; a tenth of a column of 640

# True ranges (b,) of a scan: NaN unknown, +inf nothing there; None where its frame has no truth.
Truth = Callable[[RangeScan], np.ndarray | None]


def truth_of(recording: Recording, run: Path | None) -> tuple[Truth, str]:
    """Where the truth of a recording comes from, and that in words.

    run: a result folder of `beemap map`; None: the true scans beside a rendered recording.

    Raises:
        InputError: there is none, or its files cannot be read.
    """
    if run is not None:
        return MappedTruth(run), f"map and path of {run}"
    scans = rendered_scans(recording)
    if scans is None:
        raise InputError(
            f"{recording.path}: has no true ranges ({SCANS}): map it and give the result with "
            "--run, or render one with 'beemap simulate'"
        )
    return RenderedTruth(scans, recording.path / SCANS), f"true ranges of {recording.path / SCANS}"


def rendered_scans(recording: Recording) -> TrueScans | None:
    """The true scans beside a recording; None where there are none.

    Raises:
        InputError: the file is damaged.
    """
    path = recording.path / SCANS
    if not path.is_file():
        return None
    try:
        return load_true_scans(path)
    except Exception as error:
        # A damaged archive raises whatever zipfile, zlib or numpy stumble over.
        raise InputError(f"{path}: not readable ({error}): render the recording again") from None


class RenderedTruth:
    """True ranges by the stamp of the pair."""

    def __init__(self, scans: TrueScans, source: Path):
        self.scans = scans
        self.source = source
        self._row = {stamp: row for row, stamp in enumerate(scans.stamp.tolist())}

    def row(self, scan: RangeScan) -> int | None:
        """Which of the true scans belongs to this one.

        Raises:
            InputError: its columns look elsewhere: it was made with another rig.
        """
        row = self._row.get(scan.stamp)
        bearing = self.scans.bearing
        if row is not None and (
            bearing.shape != scan.bearing.shape
            or np.max(np.abs(bearing - scan.bearing)) > SAME_BEARING
        ):
            raise InputError(
                f"{self.source}: its bearings are not those of this rig: use the rig that the "
                "recording was rendered with"
            )
        return row

    def __call__(self, scan: RangeScan) -> np.ndarray | None:
        row = self.row(scan)
        return None if row is None else self.scans.range[row].astype(float)


class MappedTruth:
    """Ranges to the first obstacle cell of a finished map, from the path that was found with it.

    A beam that meets an unknown cell before is unknown. A wall that the map draws several cells
    thick stands in their middle: half of what the beam passes of it is added, THICKEST at most.

    Raises:
        InputError: the folder holds no map or path.
    """

    def __init__(self, run: Path):
        grid = _bordered(read_map(run))
        self._grid = grid
        self._solid = grid.classes == OCCUPIED
        self._blocked = self._solid | np.isnan(grid.probability)
        path = read_tum(run / "trajectory.tum")
        self._pose = dict(zip(path.stamps.tolist(), path.poses, strict=True))

    def __call__(self, scan: RangeScan) -> np.ndarray | None:
        pose = self._pose.get(scan.stamp)
        if pose is None:
            return None
        sensor = compose(pose, np.array(scan.origin))[None]
        x, y = self._grid.origin
        ranges, stop = (
            cast(cells, x, y, self._grid.cell, sensor, scan.bearing, scan.max_range)[0][0]
            for cells in (self._solid, self._blocked)
        )
        return np.where(stop < ranges, np.nan, ranges + self._depth(sensor[0], scan, ranges))

    def _depth(self, sensor: np.ndarray, scan: RangeScan, ranges: np.ndarray) -> np.ndarray:
        """From the face of the obstacle to its middle along each beam (b,) [m]; 0 without one."""
        cell = self._grid.cell
        angle = sensor[2] + scan.bearing
        inside = np.where(np.isfinite(ranges), ranges, 0.0) + 1e-3 * cell
        at = np.stack(
            [sensor[0] + inside * np.cos(angle), sensor[1] + inside * np.sin(angle), angle], axis=1
        )
        x, y = self._grid.origin
        through = cast(~self._solid, x, y, cell, at, np.zeros(1), THICKEST * cell)[0][:, 0]
        return np.where(np.isfinite(ranges), np.minimum(through, THICKEST * cell) / 2.0, 0.0)


def _bordered(grid: OccupancyGrid) -> OccupancyGrid:
    """With a ring of unknown cells: what lies outside the map is not known."""
    wider = np.pad(grid.probability, 1, constant_values=np.nan)
    x, y = grid.origin
    return OccupancyGrid(wider, (x - grid.cell, y - grid.cell), grid.cell)
