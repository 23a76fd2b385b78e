"""Point clouds of a map and of what the cameras saw, as PLY files."""

from __future__ import annotations

import platform
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from mapping.grid import OCCUPIED, UNKNOWN, OccupancyGrid

# Points closer together than this are merged: SGBM gives no finer detail at these ranges [m].
VOXEL = 0.03

ROWS = 256  # of a map, that become points at a time
VERTEX = np.dtype(
    [("x", "<f8"), ("y", "<f8"), ("z", "<f8"), ("red", "u1"), ("green", "u1"), ("blue", "u1")]
)

SYSTEM_LIBRARIES = "libgl1 libegl1 libx11-6 libusb-1.0-0 libudev1 libidn2-0"
GLIBC = "2.35"  # the oldest that the wheels of Open3D 0.20 load on


class Open3DMissingError(RuntimeError):
    """Open3D cannot be loaded; the message says why in one line, and what to install."""


def import_open3d():
    """Open3D, imported late (0.6 s).

    Raises Open3DMissingError, with the remedy, where it cannot be loaded.
    """
    while True:
        try:
            import open3d
        except ModuleNotFoundError as error:
            raise Open3DMissingError(_not_installed(error)) from None
        except RuntimeError as error:
            # It walks through sys.modules, to which another thread's import may add meanwhile.
            if "changed size during iteration" not in str(error):
                raise Open3DMissingError(_not_loaded(error)) from None
        except Exception as error:  # a library or symbol that the system lacks, a broken install
            raise Open3DMissingError(_not_loaded(error)) from None
        else:
            return open3d


def _not_installed(error: ModuleNotFoundError) -> str:
    if error.name not in (None, "open3d"):
        return f"Open3D lacks {error.name}: pip install {error.name}"
    small = sys.platform == "linux" and platform.machine() == "x86_64"
    needs = f" (its wheels need glibc {GLIBC} or newer)" if sys.platform == "linux" else ""
    return f"Open3D is not installed: pip install {'open3d-cpu' if small else 'open3d'}{needs}"


def _not_loaded(error: Exception) -> str:
    why = " ".join(str(error).split()) or type(error).__name__
    if "GLIBC" in why:
        return f"Open3D cannot be loaded ({why}): its wheels need glibc {GLIBC} or newer"
    return (
        f"Open3D cannot be loaded ({why}): on Debian or Ubuntu run "
        f"'apt-get install {SYSTEM_LIBRARIES}'"
    )


def map_points(grid: OccupancyGrid) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Known cells as points (n, 3) at z = 0 [m] and colours (n, 3): black = wall, white = free;
    some rows of the map at a time."""
    classes = grid.classes
    for first in range(0, len(classes), ROWS):
        part = classes[first : first + ROWS]
        rows, columns = np.nonzero(part != UNKNOWN)
        x = grid.origin[0] + (columns + 0.5) * grid.cell
        y = grid.origin[1] + (first + rows + 0.5) * grid.cell
        grey = np.where(part[rows, columns] == OCCUPIED, 0.0, 1.0)
        yield np.stack([x, y, np.zeros_like(x)], axis=1), np.repeat(grey[:, None], 3, axis=1)


def write_ply(path: Path, parts: Iterable[tuple[np.ndarray, np.ndarray]]) -> int:
    """Write parts of points (n, 3) [m] with colours (n, 3) in 0..1 as one binary PLY, as they
    come; the number of points written.

    Raises OSError when the file cannot be written.
    """
    count = 0
    with path.open("wb") as file:
        file.write(_header(0))
        for points, colours in parts:
            vertices = np.empty(len(points), VERTEX)
            for axis, name in enumerate("xyz"):
                vertices[name] = points[:, axis]
            for channel, name in enumerate(("red", "green", "blue")):
                vertices[name] = np.clip(np.rint(255.0 * colours[:, channel]), 0, 255)
            file.write(vertices.tobytes())
            count += len(vertices)
        file.seek(0)
        file.write(_header(count))
    return count


def _header(count: int) -> bytes:
    """As long for any count: it is written twice."""
    return (
        f"ply\nformat binary_little_endian 1.0\ncomment {'':.<{20 - len(str(count))}}\n"
        f"element vertex {count}\n"
        "property double x\nproperty double y\nproperty double z\n"
        "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
    ).encode("ascii")
