"""TickLog: recorded wheel ticks (`odom0/data.csv`), whatever state the file is in.

Lines are `stamp [ns],left [ticks],right [ticks]`, counters as read (wrapping); `#` comments. The
comment `#reset` says that the counters began anew before the next line.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from odometry.counters import TickReading
from odometry.errors import OdometryError
from odometry.tick_track import gaps

HEADER = "#timestamp [ns],left [ticks],right [ticks]\n"
RESET = "#reset"

_STAMP = re.compile(r"\d{1,19}", re.ASCII)
_COUNT = re.compile(r"[-+]?\d{1,18}", re.ASCII)


@dataclass(frozen=True)
class TickLog:
    """stamps: (n,) int64 ns, strictly increasing; left, right: (n,) int64 raw counters.

    reset: (n,) where the counters are known to have begun anew since the reading before; none.
    skipped: lines left out, counted by reason: `garbled` (not whole numbers), `fields` (not
    three of them), `backwards` and `repeated` (time).
    """

    stamps: np.ndarray
    left: np.ndarray
    right: np.ndarray
    skipped: dict[str, int] = field(default_factory=dict)
    reset: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))

    def __post_init__(self) -> None:
        if len(self.reset) != len(self.stamps):
            object.__setattr__(self, "reset", np.zeros(len(self.stamps), bool))

    def __len__(self) -> int:
        return len(self.stamps)

    @property
    def gaps(self) -> np.ndarray:
        """(m, 2) int64 ns: last stamp before and first stamp after each gap."""
        index = np.flatnonzero(gaps(self.stamps))
        return np.stack([self.stamps[index], self.stamps[index + 1]], axis=1)


def tick_lines(reading: TickReading) -> str:
    """The line of a file of ticks for one reading; before it `#reset` where counters began anew."""
    line = f"{reading.stamp},{reading.left},{reading.right}\n"
    return f"{RESET}\n{line}" if reading.reset else line


def read_tick_log(path: str | Path) -> TickLog:
    """Read a file of ticks; damaged lines are skipped and counted.

    Raises:
        OdometryError: the file is missing or unreadable, or fewer than two lines are usable.
    """
    try:
        # A byte that is no text garbles its own line, not the file.
        text = Path(path).read_text(encoding="utf-8-sig", errors="replace")
    except FileNotFoundError:
        raise OdometryError(f"{path}: no such file") from None
    except OSError as error:
        raise OdometryError(f"{path}: cannot be read ({error.strerror or error})") from None
    return parse_tick_log(text, str(path))


def parse_tick_log(text: str, source: str) -> TickLog:
    """As `read_tick_log`, of text already read; `source` is named in errors."""
    rows, skipped = [], Counter()
    anew = []  # how many rows there were when the counters began anew
    for line in text.split("\n"):
        if line.strip() == RESET:
            anew.append(len(rows))
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        row = _parse_row(line)
        if isinstance(row, str):
            skipped[row] += 1
        else:
            rows.append(row)
    kept = _longest_increasing([row[0] for row in rows])
    stamps = {rows[i][0] for i in kept}
    left_out = set(range(len(rows))).difference(kept)
    skipped.update("repeated" if rows[i][0] in stamps else "backwards" for i in left_out)
    if len(kept) < 2:
        counts = ", ".join(f"{n} {reason}" for reason, n in sorted(skipped.items())) or "none"
        raise OdometryError(
            f"{source}: {len(kept)} usable lines, at least 2 are needed (skipped: {counts}); "
            "each line must be 'stamp [ns],left [ticks],right [ticks]'"
        )
    table = np.array([rows[i] for i in kept], np.int64)
    reset = np.zeros(len(kept), bool)
    # The first kept row at or after the remark.
    after = np.searchsorted(kept, anew)
    reset[after[after < len(kept)]] = True
    return TickLog(table[:, 0], table[:, 1], table[:, 2], dict(sorted(skipped.items())), reset)


def _parse_row(line: str) -> tuple[int, int, int] | str:
    """Stamp, left and right count; or why the line is of no use."""
    fields = [field.strip() for field in line.split(",")]
    if len(fields) != 3:
        return "fields"
    stamp, left, right = fields
    if not (_STAMP.fullmatch(stamp) and _COUNT.fullmatch(left) and _COUNT.fullmatch(right)):
        return "garbled"
    if int(stamp) >= 2**63:
        return "garbled"
    return int(stamp), int(left), int(right)


def _longest_increasing(values: list[int]) -> list[int]:
    """Indices of a longest strictly increasing subsequence (Fredman 1975).

    The fewest lines are given up this way: neither one stamp far ahead nor a clock that was
    set back takes all that follows with it.
    """
    tails: list[int] = []
    tail_index: list[int] = []
    before = [-1] * len(values)
    for i, value in enumerate(values):
        place = bisect_left(tails, value)
        before[i] = tail_index[place - 1] if place else -1
        tails[place : place + 1] = [value]
        tail_index[place : place + 1] = [i]
    chain = []
    i = tail_index[-1] if tail_index else -1
    while i >= 0:
        chain.append(i)
        i = before[i]
    return chain[::-1]
