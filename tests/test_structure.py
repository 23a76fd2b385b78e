"""The house as docs and design promise it: imports one way, quick help, short files."""

from __future__ import annotations

import ast
import subprocess
import sys
import typing
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from pipeline.settings import Settings, as_yaml, described, load_settings

ROOT = Path(__file__).parent.parent
# What each package may import of the others; a name with a dot is that module alone.
MAY_IMPORT = {
    "calibration": (),
    "odometry": (),
    "stereo": ("calibration.rig",),
    "mapping": ("stereo.scan", "odometry.motion"),
    "simulation": ("calibration", "stereo", "odometry", "mapping"),
    "pipeline": ("calibration", "stereo", "odometry", "mapping", "simulation"),
}
HEAVY = ("cv2", "numba", "open3d", "scipy")
LONGEST = 400


def sources(package: str) -> list[Path]:
    return sorted((ROOT / package).rglob("*.py"))


def imports(file: Path) -> Iterator[str]:
    """Every module that a file imports, at the top, in functions and for type checking."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module


@pytest.mark.parametrize("package", MAY_IMPORT)
def test_imports_run_one_way(package):
    allowed = (package, *MAY_IMPORT[package])
    wrong = [
        f"{file.relative_to(ROOT)} imports {module}"
        for file in sources(package)
        for module in imports(file)
        if module.partition(".")[0] in MAY_IMPORT
        and not any(module == name or module.startswith(name + ".") for name in allowed)
    ]
    assert wrong == []


def test_open3d_is_imported_inside_functions_only():
    for package in MAY_IMPORT:
        for file in sources(package):
            body = ast.parse(file.read_text(encoding="utf-8")).body
            names = [
                alias.name
                for node in body
                if isinstance(node, (ast.Import, ast.ImportFrom))
                for alias in node.names
            ]
            assert "open3d" not in names, file


def loaded_by(code: str) -> list[str]:
    """Which heavy libraries a fresh interpreter has loaded after the code."""
    code += f"\nimport sys; print([name for name in {HEAVY} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    return ast.literal_eval(done.stdout.splitlines()[-1])


@pytest.mark.parametrize("arguments", [["--help"], ["map", "--help"], ["settings"]])
def test_help_loads_nothing_heavy(arguments):
    code = (
        "import sys\nfrom pipeline.cli import main\n"
        f"sys.argv = ['beemap', *{arguments!r}]\n"
        "try:\n    main()\nexcept SystemExit as end:\n    assert not end.code"
    )
    assert loaded_by(code) == []


def test_packages_and_their_settings_load_nothing_heavy():
    modules = [*MAY_IMPORT, "stereo.settings", "odometry.settings", "mapping.settings"]
    assert loaded_by("\n".join(f"import {module}" for module in modules)) == []


def test_the_probe_for_heavy_libraries_sees_them():
    assert loaded_by("import cv2") == ["cv2"]


def test_files_are_short():
    lengths = {
        str(file.relative_to(ROOT)): len(file.read_text(encoding="utf-8").splitlines())
        for package in (*MAY_IMPORT, "tests", "benchmarks")
        for file in sources(package)
    }
    assert {name: n for name, n in lengths.items() if n > LONGEST} == {}


def test_every_setting_has_a_unit_and_a_meaning():
    told = {name: meaning for name, _, _, meaning in described()}
    for stage, struct in typing.get_type_hints(Settings).items():
        hints = typing.get_type_hints(struct, include_extras=True)
        for name in struct.__struct_fields__:
            metas = [m for m in hints[name].__metadata__ if isinstance(m, msgspec.Meta)]
            assert any("unit" in (meta.extra or {}) for meta in metas), f"{stage}.{name}"
            assert told.pop(f"{stage}.{name}"), f"{stage}.{name}"
    assert told == {}


def test_the_settings_as_printed_can_be_read_back(tmp_path, beemap):
    file = tmp_path / "settings.yaml"
    file.write_text(beemap("settings", "--yaml").out)
    assert load_settings(file) == Settings()
    changed = load_settings(None, ("mapping.cell=1e-1", "odometry.noise=[0.02, 1]"))
    assert changed.mapping.cell == 0.1
    file.write_text(as_yaml(changed))
    assert load_settings(file) == changed


def test_settings_are_listed_with_default_unit_and_meaning(beemap):
    lines = beemap("settings").out.splitlines()
    assert len(lines) == len(list(described()))
    (cell,) = [line for line in lines if line.startswith("mapping.cell ")]
    assert cell.split()[:4] == ["mapping.cell", "auto", "m", "side"]
