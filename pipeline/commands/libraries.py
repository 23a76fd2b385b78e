"""Heavy libraries made ready for a run: threads shared out, Open3D loaded beside the work."""

from __future__ import annotations

import os
import threading
from contextlib import suppress

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


class Open3DLoading:
    """Imports Open3D (0.6 s) in the background, where it is needed only at the end.

    Where it cannot be loaded the results say so.
    """

    def __init__(self) -> None:
        # No daemon: an interpreter that ends while a library is being loaded crashes.
        self._thread = threading.Thread(target=self._load)
        self._thread.start()

    def _load(self) -> None:
        from mapping.clouds import Open3DMissingError, import_open3d

        with suppress(Open3DMissingError):
            import_open3d()

    def wait(self) -> None:
        """Return when Open3D is there, or known to be missing."""
        self._thread.join()
