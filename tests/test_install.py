"""beemap works from its wheel alone, with nothing of the repository within reach."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Sequence
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = ("calibration", "stereo", "odometry", "mapping", "pipeline", "simulation")


def pip(*arguments: str | Path) -> None:
    command = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--no-input"]
    done = subprocess.run([*command, *map(str, arguments)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def installed(tmp_path_factory) -> Path:
    """A folder with the installed wheel, built from a copy so that no build/ stays behind."""
    work = tmp_path_factory.mktemp("install")
    unwanted = shutil.ignore_patterns(
        ".*", "__pycache__", "*.egg-info", "build", "data", "demo-map"
    )
    shutil.copytree(ROOT, work / "source", ignore=unwanted)
    pip("wheel", "--no-deps", "--no-build-isolation", "-w", work, work / "source")
    (wheel,) = work.glob("beemap-*.whl")
    pip("install", "--no-deps", "--no-index", "--target", work / "site", wheel)
    return work / "site"


def beemap(
    path: Sequence[Path], cwd: Path, *arguments: str, **variables: str
) -> subprocess.CompletedProcess[str]:
    """Run the installed `beemap` with nothing importable but `path` and the dependencies.

    -S leaves out the .pth files, thus the development install; the dependencies come back by name.
    """
    places = [*map(str, path), sysconfig.get_path("purelib")]
    environment = {**os.environ, **variables, "PYTHONPATH": os.pathsep.join(places)}
    command = [sys.executable, "-S", "-P", str(path[-1] / "bin" / "beemap"), *arguments]
    return subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True)


def run(installed: Path, cwd: Path, *arguments: str, **variables: str) -> str:
    """Standard output of the installed `beemap`; it must end well."""
    done = beemap([installed], cwd, *arguments, **variables)
    assert done.returncode == 0, done.stderr
    return done.stdout


def sources(folder: Path) -> set[str]:
    """Paths of all modules and package data below the packages in `folder`."""
    return {
        path.relative_to(folder).as_posix()
        for package in PACKAGES
        for ending in ("*.py", "*.yaml", "*.j2", "*.html", "*.js", "*.css", "*.svg")
        for path in (folder / package).rglob(ending)
    }


def test_wheel_holds_every_module_and_scene(installed):
    assert sources(installed) == sources(ROOT)


def test_wheel_holds_nothing_else(installed):
    names = {path.name for path in installed.iterdir() if not path.name.endswith(".dist-info")}
    assert names == {*PACKAGES, "bin"}


def test_help_and_settings(installed, tmp_path):
    assert "beemap map REC -o RUN" in run(installed, tmp_path, "--help")
    assert "mapping.particles" in run(installed, tmp_path, "settings")


def test_simulates_and_maps_outside_the_repository(installed, tmp_path):
    run(installed, tmp_path, "simulate", "office", "-o", "rec", "--duration", "2", "--quiet")
    # To compile the kernels would take far longer than to run them uncompiled on four pairs.
    few = ("--set", "mapping.particles=2")
    run(installed, tmp_path, "map", "rec", "-o", "run", "--quiet", *few, NUMBA_DISABLE_JIT="1")
    results = {path.name for path in (tmp_path / "run").iterdir()}
    wanted = {"map.png", "map.yaml", "trajectory.tum", "cloud.ply", "run.json", "report.html"}
    assert wanted <= results
