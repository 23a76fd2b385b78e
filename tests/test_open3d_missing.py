"""Without Open3D all but the renderer works, and one line says what to install."""

from __future__ import annotations

import sys

import pytest

from tests.conftest import QUICK
from tests.test_map_command import FILES

LOADER = "libEGL.so.1: cannot open shared object file: No such file or directory"
# How loading fails, and what the line says.
WAYS = [
    (ModuleNotFoundError("No module named 'open3d'", name="open3d"), ": pip install open3d"),
    (ModuleNotFoundError("No module named 'dash'", name="dash"), ": pip install dash"),
    (ImportError(LOADER), f"({LOADER}): on Debian or Ubuntu run 'apt-get install libgl1 "),
    (OSError(LOADER), f"({LOADER}): on Debian or Ubuntu run 'apt-get install libgl1 "),
    (ImportError("libc.so.6: version `GLIBC_2.35' not found"), "need glibc 2.35 or newer"),
    (AttributeError("half an\ninstallation"), "cannot be loaded (half an installation)"),
]


class Failing:
    """An importer that fails to load Open3D."""

    def __init__(self, error: Exception) -> None:
        self.error = error

    def find_spec(self, name, path=None, target=None):
        if name == "open3d":
            raise self.error


def fail(monkeypatch, error: Exception) -> None:
    monkeypatch.delitem(sys.modules, "open3d", raising=False)
    monkeypatch.setattr(sys, "meta_path", [Failing(error), *sys.meta_path])


def test_map_writes_everything(beemap, office_piece, tmp_path, monkeypatch):
    fail(monkeypatch, ImportError(LOADER))
    done = beemap("map", office_piece, "-o", tmp_path / "run", *QUICK)
    assert done.code == 0, done.err
    assert {file.name for file in (tmp_path / "run").iterdir()} == set(FILES)


@pytest.mark.parametrize(("error", "said"), WAYS)
def test_what_needs_the_renderer_says_what_to_install(refused, tmp_path, monkeypatch, error, said):
    fail(monkeypatch, error)
    assert said in refused("simulate", "office", "-o", tmp_path / "rec")
    assert list(tmp_path.iterdir()) == []


def test_the_virtual_rig_of_a_preset_says_it_too(refused, tmp_path, monkeypatch):
    fail(monkeypatch, ImportError(LOADER))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert LOADER in refused("simulate", "rig", "--preset", "office", "-o", tmp_path / "rig")
    assert not (tmp_path / "rig").exists()
