"""Point clouds of a map and of what the cameras saw, written by Open3D."""

from __future__ import annotations

import platform
import sys
from pathlib import Path

import numpy as np

from mapping.grid import OCCUPIED, UNKNOWN, OccupancyGrid

# Points closer together than this are merged: SGBM gives no finer detail at these ranges [m].
VOXEL = 0.03

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


def map_points(grid: OccupancyGrid) -> tuple[np.ndarray, np.ndarray]:
    """Known cells as points (n, 3) at z = 0 [m] and colours (n, 3): black = wall, white = free."""
    classes = grid.classes
    rows, columns = np.nonzero(classes != UNKNOWN)
    x = grid.origin[0] + (columns + 0.5) * grid.cell
    y = grid.origin[1] + (rows + 0.5) * grid.cell
    grey = np.where(classes[rows, columns] == OCCUPIED, 0.0, 1.0)
    return np.stack([x, y, np.zeros_like(x)], axis=1), np.repeat(grey[:, None], 3, axis=1)


def write_ply(path: Path, points: np.ndarray, colours: np.ndarray, voxel: float = 0.0) -> int:
    """Write points (n, 3) [m] with colours (n, 3) in 0..1 as binary PLY; the number written.

    voxel: merge points within cubes of this side [m]; 0 keeps all.
    Raises OSError when the file cannot be written.
    """
    o3d = import_open3d()
    cloud = o3d.geometry.PointCloud(
        o3d.utility.Vector3dVector(np.ascontiguousarray(points, np.float64)),
    )
    cloud.colors = o3d.utility.Vector3dVector(np.ascontiguousarray(colours, np.float64))
    if voxel > 0.0 and len(points):
        cloud = cloud.voxel_down_sample(voxel)
    # Open3D refuses to write an empty cloud; an empty PLY is a header alone.
    if not len(cloud.points):
        path.write_text(_EMPTY_PLY, encoding="ascii")
        return 0
    if not o3d.io.write_point_cloud(path, cloud):
        raise OSError(None, "Open3D could not write the file", str(path))
    return len(cloud.points)


_EMPTY_PLY = (
    "ply\nformat binary_little_endian 1.0\nelement vertex 0\n"
    "property double x\nproperty double y\nproperty double z\n"
    "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
)
