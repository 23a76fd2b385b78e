"""What only an extra brings is asked for by name, and beemap works without it."""

from __future__ import annotations

import ast
import json
import re
import subprocess
import sys
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, requires

import pytest

from pipeline.errors import InputError
from pipeline.extras import MODULES, need
from tests.test_structure import MAY_IMPORT, ROOT, sources

# Everything that an extra brings, by the names of its packages and of what comes along.
BLOCKED = (*(name for names in MODULES.values() for name in names), "dask")
# Distributions, where they are not called as the module they bring.
DISTRIBUTIONS = {"rerun": "rerun-sdk"}
# A command that needs an extra, and the extra. `data/office` is there to be read.
COMMANDS = {
    ("view", "RUN"): "view",
    ("export", "RUN", "-o", "OUT"): "ros",
    ("import", "drive.bag", "-o", "OUT"): "ros",
    ("replay", "data/office", "--web"): "web",
    ("live", "rig.yaml", "-o", "OUT", "--web"): "web",
    (
        "calibrate",
        "capture",
        "rig.yaml",
        "-o",
        "OUT",
        "--board",
        "x",
        "--square",
        "x",
        "--web",
    ): "web",
    ("batch", "data/office", "-o", "OUT", "--scheduler", "tcp://127.0.0.1:1"): "cluster",
    ("experiment", "table", "-o", "OUT", "--scheduler", "tcp://127.0.0.1:1"): "cluster",
}
# The program in an interpreter where the modules of all extras are missing.
WITHOUT = """
import io, json, sys
from contextlib import redirect_stderr, redirect_stdout

class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {blocked!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Missing())
from pipeline.cli import main

outcomes = []
for arguments in {commands!r}:
    sys.argv = ["beemap", *arguments]
    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()) as said:
        try:
            main()
        except SystemExit as end:
            outcomes.append([end.code, said.getvalue()])
print(json.dumps(outcomes))
"""


def test_without_the_extras_the_rest_works_and_the_others_say_what_to_install(tmp_path):
    plain = [["--help"], ["map", "--help"], ["settings"], ["info", "data/office"]]
    needing = [[word.replace("OUT", str(tmp_path / "out")) for word in words] for words in COMMANDS]
    code = WITHOUT.format(blocked=BLOCKED, commands=[*plain, *needing])
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    outcomes = json.loads(done.stdout)
    assert outcomes[: len(plain)] == [[0, ""]] * len(plain)
    for (code, said), extra in zip(outcomes[len(plain) :], COMMANDS.values(), strict=True):
        assert code == 2
        assert said.startswith("beemap: ")
        assert said.endswith(f": pip install 'beemap[{extra}]'\n")
        assert said.count("\n") == 1
    assert not (tmp_path / "out").exists()


def required(extra: str | None, package: str = "beemap") -> set[str]:
    """Distributions that a package requires, by itself (None) or with an extra."""
    names = set()
    for line in requires(package) or []:
        name = re.match(r"[\w.-]+", line)
        marker = re.search(r"extra == ['\"](\w+)['\"]", line)
        assert name is not None
        if (marker and marker[1]) == extra:
            names.add(name[0].lower())
    return names


def test_a_plain_installation_brings_nothing_of_the_extras():
    plain, waiting = set(), ["beemap"]
    while waiting:
        with suppress(PackageNotFoundError):  # of another platform
            new = required(None, waiting.pop()) - plain
            plain |= new
            waiting += new
    assert {"numpy", "click", "jinja2", "markupsafe"} <= plain
    assert plain.isdisjoint({*BLOCKED, *DISTRIBUTIONS.values()})
    for extra, modules in MODULES.items():
        assert required(extra) == {DISTRIBUTIONS.get(name, name) for name in modules}


@pytest.mark.parametrize("package", MAY_IMPORT)
def test_extras_are_imported_inside_functions_or_in_their_own_packages(package):
    for file in sources(package):
        own = MODULES.get(file.parent.name, ()) if package == "pipeline" else ()
        for node in ast.parse(file.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                names = [node.module]
            else:
                continue
            found = {name.partition(".")[0] for name in names} & set(BLOCKED)
            assert found <= set(own), file


def test_what_is_there_is_not_asked_for(monkeypatch):
    monkeypatch.setitem(MODULES, "cluster", ("json",))
    need("cluster", "--scheduler")
    monkeypatch.setitem(MODULES, "cluster", ("json", "no_such_module"))
    with pytest.raises(InputError) as error:
        need("cluster", "--scheduler")
    line = "--scheduler: needs no_such_module: pip install 'beemap[cluster]'"
    assert str(error.value) == line
    assert isinstance(error.value.__cause__, ModuleNotFoundError)
