"""Heavy libraries made ready for a run: threads shared out."""

from __future__ import annotations

import os

from pipeline.errors import InputError


def use_threads(threads: int) -> None:
    """Share the cores out: OpenCV one (frames run beside each other), numba all."""
    # Threads that wait for their next loop must not take the core from those that match images.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    import cv2
    import numba

    cv2.setNumThreads(1)
    # The default layer is not safe beside other threads; on Linux GNU OpenMP is always there.
    if os.name == "posix" and hasattr(os, "sched_getaffinity"):
        numba.config.THREADING_LAYER = "omp"  # pyright: ignore
    most = numba.config.NUMBA_NUM_THREADS  # pyright: ignore
    try:
        numba.set_num_threads(min(threads, most))
    except ValueError as error:
        raise InputError(
            f"numba finds no threads ({error}): on Debian or Ubuntu run 'apt-get install libgomp1'"
        ) from None
