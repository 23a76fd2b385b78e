"""CaptureNews: what changed while pairs of a board are taken, as messages to the page.

capture     name, board, phase, images looked at, how it ended
views       where boards were, as a picture, and what is missing; where to hold it next
pair        both images as JPEG, the corners found in them, how still and sharp the board is
thumbnails  of the left images that were kept
verdict     of the calibration
"""

from __future__ import annotations

import secrets
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from calibration.verdict import MEANING
from pipeline.board_capture import SHARP, STILL, Look
from pipeline.board_ghost import find_ghost
from pipeline.board_views import ENOUGH_COVERAGE, ENOUGH_PAIRS
from pipeline.calibration_report.next_steps import next_steps
from pipeline.calibration_report.tables import facts
from pipeline.web import capture_pictures as pictures
from pipeline.web.capture_state import CaptureState
from pipeline.web.encoding import packed
from pipeline.web.messages import Message

# A pair that was judged is shown, with its corners, unless the newest is so much newer [ns].
LAG = 250_000_000
THUMBNAILS_AT_ONCE = 3
MOST_OVER = 9.0  # times a limit that are told apart
MAIN_FACTS = ("pairs used", "held-out rows", "baseline", "covered", "depth error", "usable range")


class CaptureNews:
    """rig_file: what is calibrated; folder: of the pairs. Used by one thread."""

    def __init__(self, state: CaptureState, rig_file: Path, folder: Path) -> None:
        self._state = state
        self._rig_file = rig_file
        self._folder = folder
        self._id = secrets.token_hex(4)  # a page that finds another capture begins anew
        self._sent: dict[str, Any] = {}
        self._thumbnails: list[bytes] = []

    def __iter__(self) -> Iterator[Message]:
        """What changed since the last time."""
        yield from self._capture()
        yield from self._views()  # before the pair: whether it is held as asked is seen there
        yield from self._pair()
        yield from self._kept()
        yield from self._verdict()

    def _capture(self) -> Iterator[Message]:
        state = self._state
        board = state.views.board
        values = {
            "id": self._id,
            "name": self._rig_file.name,
            "board": f"{board.name}, {board.square * 1e3:g} mm",
            "folder": str(self._folder),
            "phase": state.phase,
            "looked_at": state.looked_at,
            "said": state.said,
        }
        if self._sent.get("capture") != values:
            self._sent["capture"] = values
            yield Message("capture", values)

    def _views(self) -> Iterator[Message]:
        views = self._state.views
        if views.size is None or not self._is_new("views", views):
            return
        masks = [c.covered for c in views.covered] or [np.zeros((1, 1), bool)] * 2
        height, width = masks[0].shape
        values = {
            "kept": len(views.kept),
            "enough": ENOUGH_PAIRS,
            "size": views.size,
            "width": width,
            "height": height,
            "shares": [c.share for c in views.covered] or [0.0, 0.0],
            "enough_share": ENOUGH_COVERAGE,
            "lacking": views.lacking,
            "distances": views.bars["distance"] == 1.0,
            "wishes": [str(wish) for wish in views.wishes],
            "ghost": pictures.as_values(find_ghost(views), views.size),
        }
        yield Message("views", values, packed(np.array(masks, np.uint8)))

    def _pair(self) -> Iterator[Message]:
        state = self._state
        pair, look = state.judged or (None, None)
        newest = state.camera.newest if state.camera else None
        if newest is not None and (pair is None or newest.stamp - pair.stamp > LAG):
            pair = newest
        if pair is None or not self._is_new("pair", pair):
            return
        images = pictures.both_images(pair)
        if images is None:
            return
        seen = (None, None) if look is None else look.seen
        corners = [pictures.corners_of(one, state.views.size) for one in seen]
        parts = [*corners, *images]
        values = {"sizes": [len(part) for part in parts], **self._looked(look)}
        yield Message("pair", values, b"".join(parts))

    def _looked(self, look: Look | None) -> dict[str, Any]:
        """What became of a pair; `moved` and `blur`: over what they may be."""
        views = self._state.views
        if look is None or views.size is None:
            return {"why": "", "moved": None, "blur": None, "outline": None}
        return {
            "why": look.why,
            "moved": _over(look.moved, STILL * views.size[0]),
            "blur": _over(look.blur, SHARP),
            "outline": pictures.outline_of(look.seen[0], views.board, views.size),
        }

    def _kept(self) -> Iterator[Message]:
        known = len(self._thumbnails)
        last = min(known + THUMBNAILS_AT_ONCE, len(self._state.views.kept))
        if last > known:
            self._thumbnails += pictures.thumbnails(self._folder / "left", known + 1, last)
            sizes = [len(one) for one in self._thumbnails]
            yield Message("thumbnails", {"sizes": sizes}, b"".join(self._thumbnails))

    def _verdict(self) -> Iterator[Message]:
        solved = self._state.solved
        if solved is None or not self._is_new("verdict", solved):
            return
        result = solved.result
        word = result.judgement.verdict
        values = {
            "verdict": word,
            "rows": f"{result.heldout.row_rms:.3f} px",
            "meaning": MEANING[word],
            "steps": next_steps(result, self._rig_file),
            "facts": [fact for fact in facts(result) if fact[0] in MAIN_FACTS],
            "rig_file": str(self._rig_file),
            "report": str(solved.report),
        }
        yield Message("verdict", values)

    def _is_new(self, topic: str, what: object) -> bool:
        """Whether it is another object than was sent last; then it counts as sent."""
        new = self._sent.get(topic) is not what
        self._sent[topic] = what
        return new


def _over(value: float | None, limit: float) -> float | None:
    return None if value is None else round(min(value / limit, MOST_OVER), 3)
