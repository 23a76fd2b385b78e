"""What beemap needs of this machine beside Python. Runs with any Python 3, nothing installed.

machine.py libraries [MANAGER]: shared libraries that cannot be loaded, one a line, each with the
package that brings it. machine.py requirements: what pip is to install before beemap itself.
"""

import ctypes
import platform
import re
import struct
import sys
import sysconfig
from pathlib import Path

# soname: packages of apt-get and of pacman; dnf finds a package by the soname itself.
ALWAYS = {
    "libstdc++.so.6": ("libstdc++6", "gcc-libs"),
    "libgomp.so.1": ("libgomp1", "gcc-libs"),  # numba's threads
}
OPEN3D = {
    "libGL.so.1": ("libgl1", "libglvnd"),
    "libEGL.so.1": ("libegl1", "libglvnd"),
    "libX11.so.6": ("libx11-6", "libx11"),
    "libusb-1.0.so.0": ("libusb-1.0-0", "libusb"),
    "libudev.so.1": ("libudev1", "systemd-libs"),
    "libidn2.so.0": ("libidn2-0", "libidn2"),
}
OPEN3D_GLIBC = (2, 35)  # the oldest that the wheels of Open3D 0.20 load on


def unsupported():
    """Why no wheels of the libraries below beemap exist for this machine; "" where they do."""
    if struct.calcsize("P") < 8:
        return "beemap needs a 64-bit Python: numba and OpenCV have no wheels for this one"
    if "musl" in (sysconfig.get_config_var("SOABI") or ""):
        return (
            "beemap needs glibc: numba and OpenCV have no wheels for musl (Alpine): use Debian, "
            "Ubuntu, Fedora or Arch"
        )
    return ""


def open3d_fits():
    """Whether there is a wheel of Open3D for this Linux; its markers know all but the glibc."""
    name, version = platform.libc_ver()
    numbers = tuple(int(n) for n in re.findall(r"\d+", version)[:2])
    known = platform.machine() in ("x86_64", "aarch64")
    return known and name == "glibc" and numbers >= OPEN3D_GLIBC


def missing():
    """Sonames that the loader does not find, whatever ldconfig knows; with their packages."""
    if platform.system() != "Linux":
        return {}
    found = {}
    for soname, packages in {**ALWAYS, **(OPEN3D if open3d_fits() else {})}.items():
        try:
            ctypes.CDLL(soname)
        except OSError:
            found[soname] = packages
    return found


def package(manager, soname, packages):
    """The package, as `manager` names it."""
    if manager == "dnf":
        return soname + "()(64bit)"
    return packages[1] if manager == "pacman" else packages[0]


def requirements(project):
    """Requirements of a pyproject.toml as lines for `pip install -r`."""
    import tomllib

    lines = tomllib.loads(project.read_text(encoding="utf-8"))["project"]["dependencies"]
    if platform.system() != "Linux" or open3d_fits():
        return lines
    return [line for line in lines if not line.startswith("open3d")]


if __name__ == "__main__":
    if sys.argv[1] == "requirements":
        print("\n".join(requirements(Path(__file__).parent.parent / "pyproject.toml")))
    elif unsupported():
        sys.exit(unsupported())
    else:
        manager = (sys.argv[2:] or [""])[0]
        for soname, packages in missing().items():
            print(soname, package(manager, soname, packages))
