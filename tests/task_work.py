"""Tasks that need nothing heavy, for the tests of those who do them. A task is (number, folder)."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

from pipeline.errors import InputError
from pipeline.tasks.task import place

Task = tuple[int, str]
POISON = 13


def note(task: Task, what: str) -> int:
    """Leave a file that says what was done; how many of the kind there are."""
    number, folder = task
    (Path(folder) / f"{what}-{number}-{os.getpid()}-{time.monotonic_ns()}").touch()
    return len(list(Path(folder).glob(f"{what}-{number}-*")))


def square(task: Task) -> tuple[int, int, int]:
    """(number squared, its process, its threads)."""
    note(task, "did")
    return task[0] ** 2, os.getpid(), place().threads


def mortal(task: Task) -> int:
    """Negative numbers kill their process the first time, POISON always does; 0 is a bug, 1 a
    mistake of the user."""
    number = task[0]
    if number == 0:
        raise ZeroDivisionError("no such\nthing")
    if number == 1:
        raise InputError("one: write two")
    if number == POISON or (number < 0 and note(task, "begun") == 1):
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def telling(task: Task) -> int:
    """Says how far it is."""
    time.sleep(0.6)
    place().tell(0.25)
    place().tell(0.26)  # too soon after
    time.sleep(0.6)
    place().tell(0.5)
    return task[0]


def endless(task: Task) -> int:
    """Beats and tells until it is ended."""
    while True:
        note(task, "beat")
        place().tell(0.5)
        time.sleep(0.05)
