"""Whether a column's match stands out: blinds, tiles and blank walls match in many places.

SGBM's own uniqueness test does not see repetition: a whole region shifted by a period costs it
one step at the region's border. So the winner is asked again, without neighbours: the raw cost
of a window at every disparity (winner margin; Hu and Mordohai 2012).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from stereo.disparity import SUBPIXEL

GROUP = 4  # columns that share a verdict
ROWS = 12  # rows of a column that are compared, spread over those that agree on its range
REACH = 10  # columns to either side [px]
LEAST = 5  # columns that tell anything
# A rival is a disparity further away than this [px].
OWN = 2
# Below this share of what disparities cost on average, costs tell of sampling, not of a match.
SAMPLING = 0.12


@njit(cache=True, nogil=True)
def margins(disparity, left, right, winner, bins):
    """(W,) least cost of any rival over that of the winner, on the side where it is greatest (the
    left of a column, its right, both); NaN where nothing can be compared.

    disparity (H, W) int16 sixteenths; left, right (H, W) int16 gradients across both images;
    winner (W,) disparity of each column [px], NaN where there is none. One column of each GROUP
    speaks for all that answer.
    """
    rows, columns = disparity.shape
    margin = np.full(columns, np.nan)
    agreeing = np.empty(rows, np.int64)
    costs = np.empty((3, bins))
    for begin in range(0, columns, GROUP):
        end = min(begin + GROUP, columns)
        u = begin + GROUP // 2
        for at in range(begin, end):
            if u >= columns or not winner[u] > 0.0:
                u = at
        if not winner[u] > 0.0:
            continue
        found = 0
        for v in range(rows):
            if abs(disparity[v, u] / SUBPIXEL - winner[u]) <= OWN:
                agreeing[found] = v
                found += 1
        first, last = max(u - REACH, 0), min(u + REACH + 1, columns)
        limit = min(bins, u + 1)
        taken = min(found, ROWS)
        if taken < 2 or limit <= winner[u]:
            continue
        for d in range(limit):
            before = after = 0
            start = max(first, d)  # left of it the right image ends
            for k in range(taken):
                v = agreeing[k * found // taken]
                for x in range(start, u + 1):
                    before += abs(np.int32(left[v, x]) - np.int32(right[v, x - d]))
                for x in range(u + 1, last):
                    after += abs(np.int32(left[v, x]) - np.int32(right[v, x - d]))
            costs[0, d] = before / (u + 1 - start) if u - start >= LEAST else np.inf
            costs[1, d] = after / (last - u - 1) if last - u > LEAST else np.inf
            costs[2, d] = (before + after) / (last - start)
        # Beside an outline, the window on one side shows another surface.
        best = -1.0
        for side in range(3):
            own, rival = _own_and_rival(costs[side, :limit], winner[u])
            if own < np.inf and rival < np.inf:
                best = max(best, rival / own)
        if best >= 0.0:
            margin[begin:end] = best
    return margin


@njit(cache=True, nogil=True)
def _own_and_rival(costs, winner):
    """Least of the costs (bins,) within OWN of the winner, never below SAMPLING of their mean
    and 1, and least of all others.

    The others count between whole disparities too: of blinds that match at 14.8 and 20.9 px, the
    wrong 21 px would seem to stand out from 15 px. Sums of absolute differences draw a V about
    a minimum; its tip lies half the difference of both neighbours below the least whole one
    (equiangular fit; Shimizu and Okutomi 2005).
    """
    own = rival = np.inf
    total, number = 0.0, 0
    for d in range(costs.size):
        cost = costs[d]
        if cost < np.inf:
            total += cost
            number += 1
        if abs(d - winner) <= OWN:
            own = min(own, cost)
            continue
        if 0 < d < costs.size - 1:
            before, after = costs[d - 1], costs[d + 1]
            if cost <= min(before, after) and max(before, after) < np.inf:
                cost = max(0.0, cost - 0.5 * abs(before - after))
        rival = min(rival, cost)
    return max(own, SAMPLING * total / max(number, 1), 1.0), rival
