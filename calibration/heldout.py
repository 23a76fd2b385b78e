"""The row error of pairs that the rig was not solved from.

A reprojection error falls with every parameter that is added to a lens. The row error of pairs
left out does not, and it is what a stereo matcher meets.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calibration.epipolar import row_differences
from calibration.lens import LENSES
from calibration.solution import StereoSolution
from calibration.solve import geometry_of, observe, rig_of, settle

# From this many pairs on they are left out in 10 groups instead of one by one.
MANY_PAIRS = 20
GROUPS = 10


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Rectified row errors of pairs by rigs that were solved without them.

    rows: per view (n,) px, right less left, of all corners seen in both images, none rejected.
    groups: (views,) int: which views were left out together; -1 for an outlier view, which the
        full rig was not solved from either.
    """

    rows: tuple[np.ndarray, ...]
    groups: np.ndarray

    @property
    def row_rms(self) -> float:
        """Over all corners of the views that the full rig was solved from [px]."""
        used = [rows for rows, g in zip(self.rows, self.groups, strict=True) if g >= 0]
        return _rms(np.concatenate(used))

    @property
    def view_rms(self) -> np.ndarray:
        """Of each view (views,) [px], outlier views too; NaN without a common corner."""
        return np.array([_rms(rows) for rows in self.rows])


def held_out(solution: StereoSolution, spherical: bool | None = None) -> HeldOut:
    """Leave pairs out, solve from the others, and measure the row error of those left out.

    Each group's rig starts from the full solution and rejects corners by itself. Less than 20
    pairs are left out one by one, more in 10 groups. `spherical` as in `row_differences`.
    """
    used = np.array(solution.used_views)
    groups = np.full(len(solution.views), -1)
    groups[used] = np.arange(len(used)) % (GROUPS if len(used) >= MANY_PAIRS else len(used))
    lens = LENSES[solution.lens]
    seen, geometry = observe(solution.views, solution.points), geometry_of(solution, lens)
    rigs = {-1: solution.rig}
    for group in range(groups.max() + 1):
        rest = used[groups[used] != group]
        found, _, _ = settle(lens, seen.views(rest), geometry.views(rest))
        rigs[group] = rig_of(lens, found, solution.rig.image_size)
    rows = []
    for view, group in zip(solution.views, groups.tolist(), strict=True):
        _, left, right = view.common()
        rows.append(row_differences(rigs[group], left, right, spherical))
    return HeldOut(tuple(rows), groups)


def _rms(rows: np.ndarray) -> float:
    return float(np.sqrt(np.mean(rows**2))) if rows.size else float("nan")
