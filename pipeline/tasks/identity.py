"""What a result depends on beside its task: the source of beemap and the libraries below it.

`identity` is sent to the workers of a cluster by value, as they may hold another beemap: it uses
nothing of beemap but this file, and imports in the function.
"""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("calibration", "stereo", "odometry", "mapping", "simulation", "pipeline")
LIBRARIES = ("beemap", "numpy", "scipy", "numba", "opencv-contrib-python-headless")
SOURCE = "source of beemap"


@cache
def source_digest(patterns: tuple[str, ...]) -> str:
    """Digest of beemap's source files under these names."""
    digest = hashlib.sha256()
    for pattern in patterns:
        for file in sorted(ROOT.glob(pattern)):
            digest.update(file.relative_to(ROOT).as_posix().encode() + file.read_bytes())
    return digest.hexdigest()


def identity() -> dict[str, str]:
    """Versions of beemap, of its source and of the libraries; "missing" where there is none."""
    import hashlib
    from importlib.metadata import PackageNotFoundError, version
    from importlib.util import find_spec
    from pathlib import Path

    found = {}
    for name in LIBRARIES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "missing"
    digest = hashlib.sha256()
    for package in PACKAGES:
        spec = find_spec(package)
        for place in (spec and spec.submodule_search_locations) or ():
            for file in sorted(Path(place).rglob("*.py")):
                digest.update(file.relative_to(place).as_posix().encode() + file.read_bytes())
    return {**found, SOURCE: digest.hexdigest()[:12]}
