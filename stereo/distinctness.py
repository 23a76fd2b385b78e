"""Whether a column's match stands out: blinds, tiles and blank walls match in many places.

SGBM's own uniqueness test does not see repetition: a whole region shifted by a period costs it
one step at the region's border. So the winner is asked again, without neighbours: the raw cost
of a window at every disparity (winner margin; Hu and Mordohai 2012).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from stereo.disparity import SUBPIXEL

GROUP = 4  # columns that share a verdict
ROWS = 12  # rows of a column that are compared, spread over those that agree on its range
REACH = 10  # columns to either side [px]
LEAST = 5  # columns that tell anything
# SGBM's disparities are off by no more than this towards whole pixels.
LOCKING = 0.4
# How far a wrong mount may shift the floor's disparities [px].
TILT = 2
# A rival is a disparity further away than this [px].
OWN = 2
# Below this share of what disparities cost on average, costs tell of sampling, not of a match.
SAMPLING = 0.12


@njit(cache=True, nogil=True)
def margins(disparity, left, right, winner, floor, shares, bins):
    """Margins (W,): least cost of any rival over that of the winner, on the side where it is
    greatest (the left of a column, its right, both); NaN where nothing can be compared. Offsets
    (W,) [px]: from the winner to the least cost between whole pixels.

    disparity (H, W) int16 sixteenths; left, right (H, W) int16 gradients across both images;
    winner (W,) disparity of each column [px], NaN where there is none; floor: (per column, per
    row, at the corner) disparity of the floor, linear in the image; shares: of a winner, that the
    floor's disparity may be for a row to show what stands (in lower rows the floor in front is
    seen, whose match is right), and for that to be high. One column of each GROUP speaks for all
    that answer.

    The floor is a rival of its own: a row of tiles matches as well one tile further, at one
    disparity for all rows, where the floor itself has another for each. What is low must stand
    out twice as much.
    """
    rows, columns = disparity.shape
    margin = np.full(columns, np.nan)
    offset = np.zeros(columns)
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
        found, low = 0, True
        for v in range(rows):
            floor_here = floor[0] * u + floor[1] * v + floor[2]
            if floor_here > shares[0] * winner[u]:
                continue
            if abs(disparity[v, u] / SUBPIXEL - winner[u]) <= OWN:
                low = low and floor_here > shares[1] * winner[u]
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
        floors = _floor_costs(left, right, agreeing, found, taken, u, first, last, floor)
        # Beside an outline, the window on one side shows another surface.
        best = -1.0
        for side in range(3):
            own, rival = _own_and_rival(costs[side, :limit], winner[u])
            rival = min(rival, floors[side])
            if own < np.inf and rival < np.inf:
                # Chance makes a few pixels stand out more than many.
                width = (u + 1 - first, last - u - 1, last - first)[side]
                sure = math.sqrt(taken * width / (ROWS * (2 * REACH + 1)))
                best = max(best, 1.0 + sure * (rival / own - 1.0))
        if low:
            best = 1.0 + 0.5 * (best - 1.0)
        if best >= 0.0:
            margin[begin:end] = best
        offset[begin:end] = _fine(costs[2, :limit], winner[u]) - winner[u]
    return margin, offset


@njit(cache=True, nogil=True)
def _fine(costs, winner):
    """Disparity of the least cost near the winner, between whole pixels (equiangular fit); the
    winner itself where there is none near.

    SGBM's own parabola is drawn towards whole pixels by up to 0.3 px (pixel locking; Shimizu and
    Okutomi 2005): on a textured plane this fit errs by 0.02.
    """
    whole = min(round(winner), costs.size - 1)
    for d in (whole - 1, whole + 1):
        if 0 <= d < costs.size and costs[d] < costs[whole]:
            whole = d
    if not 0 < whole < costs.size - 1:
        return winner
    before, least, after = costs[whole - 1], costs[whole], costs[whole + 1]
    steep = max(before, after) - least
    if not steep > 0.0 or min(before, after) < least:
        return winner
    fine = whole + 0.5 * (before - after) / steep
    return fine if abs(fine - winner) <= LOCKING else winner


@njit(cache=True, nogil=True)
def _floor_costs(left, right, agreeing, found, taken, u, first, last, floor):
    """Cost (3,) a pixel left of the column, right of it and of both if the rows were floor; inf
    where most of them cannot be. The mount's doubt may shift all rows by up to TILT pixels."""
    columns = left.shape[1]
    costs = np.full(3, np.inf)
    for shift in range(-TILT, TILT + 1):
        before = after = number = 0
        for k in range(taken):
            v = agreeing[k * found // taken]
            d = round(floor[0] * u + floor[1] * v + floor[2]) + shift
            if d < 0 or first - d < 0 or last - d > columns:
                continue
            number += 1
            for x in range(first, u + 1):
                before += abs(np.int32(left[v, x]) - np.int32(right[v, x - d]))
            for x in range(u + 1, last):
                after += abs(np.int32(left[v, x]) - np.int32(right[v, x - d]))
        if 2 * number <= taken:
            continue
        # In sums over all rows taken, as the other costs are.
        scale = taken / number
        costs[0] = min(costs[0], scale * before / (u + 1 - first))
        if last > u + 1:
            costs[1] = min(costs[1], scale * after / (last - u - 1))
        costs[2] = min(costs[2], scale * (before + after) / (last - first))
    return costs


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
