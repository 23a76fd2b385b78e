"""A task as the process that does it sees it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from pipeline.errors import for_user

T = TypeVar("T")
R = TypeVar("R")

TELL_EVERY = 0.5  # seconds


@dataclass(frozen=True)
class Failure:
    """Why a task has no result, in one line."""

    reason: str


class Place:
    """Where a task is done: how many threads it may use, and whom it tells how far it is."""

    def __init__(self, threads: int, tell: Callable[[float], None]) -> None:
        self.threads = threads
        self._tell = tell
        self._told = time.monotonic()

    def tell(self, share: float) -> None:
        """Say which share (0 to 1) of the task is done; what comes too often is not passed on."""
        now = time.monotonic()
        if now - self._told >= TELL_EVERY:
            self._told = now
            self._tell(share)


_place = Place(1, lambda share: None)


def place() -> Place:
    """Of the task that this process is doing."""
    return _place


def perform(work: Callable[[T], R], task: T, where: Place) -> R | Failure:
    """work(task), or why there is no result; `place()` is `where` meanwhile."""
    global _place
    _place = where
    try:
        return work(task)
    except Exception as error:
        bug = " ".join(f"{type(error).__name__}: {error}".split())
        return Failure(for_user(error) or bug)
