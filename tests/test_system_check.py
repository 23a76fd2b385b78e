"""What `make` and `.ci/run` look for before they download anything, on machines that lack it."""

from __future__ import annotations

import ctypes
import importlib.util
import platform
import shutil
import struct
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from mapping.clouds import GLIBC, SYSTEM_LIBRARIES

CI = Path(__file__).parent.parent / ".ci"
VENV_PACKAGE = f"python{sys.version_info[0]}.{sys.version_info[1]}-venv"
TOOLS = ("cat", "dirname", "env", "grep", "mkdir", "mktemp", "rm", "sh", "tail", "touch", "true")
# Libraries come with a line in the file `missing`, and go when apt-get has installed something;
# apt-get knows nothing before its lists are there.
MACHINE = "from pathlib import Path; print(Path(__file__).with_name('missing').read_text(), end='')"
APT_GET = """
echo "apt-get $*" >>{home}/calls
case "$*" in
  *update*) touch {home}/lists ;;
  *) [ -e {home}/lists ] || {{ echo "E: Unable to locate package" >&2; exit 100; }}
     : >{home}/.ci/missing; rm -f {home}/no-venv ;;
esac
"""
PYTHON = """
case "$*" in *ensurepip*) [ ! -e {home}/no-venv ] || exit 3 ;; esac
exec {python} "$@"
"""
OLD = 'case "$*" in *ensurepip*) exit 1 ;; *version_info*) echo 3.9.2 ;; esac'


class Computer:
    """A machine of which only `bin` is on the PATH."""

    def __init__(self, home: Path) -> None:
        self.home = home
        (home / "bin").mkdir()
        (home / ".ci").mkdir()
        for script in ("system", "install"):
            shutil.copy(CI / script, home / ".ci")
        (home / ".ci" / "machine.py").write_text(MACHINE)
        self.lacks("")
        for tool in TOOLS:
            found = shutil.which(tool)
            assert found is not None
            (home / "bin" / tool).symlink_to(found)
        self.has("python3", PYTHON)
        self.has("id", "echo 1000")

    def has(self, name: str, script: str) -> None:
        text = script.replace("{python}", sys.executable).replace("{home}", str(self.home))
        program = self.home / "bin" / name
        program.write_text("#!/bin/sh\n" + text.replace("{{", "{").replace("}}", "}") + "\n")
        program.chmod(0o755)

    def lacks(self, lines: str) -> None:
        (self.home / ".ci" / "missing").write_text(lines)

    def run(self, script: str, *arguments: str, **variables: str) -> tuple[int, str, str]:
        """Exit code, standard output and standard error, without blanks at the end."""
        command = ["/bin/sh", str(self.home / ".ci" / script), *arguments]
        environment = {"PATH": str(self.home / "bin"), **variables}
        done = subprocess.run(command, env=environment, capture_output=True, text=True)
        return done.returncode, done.stdout.rstrip(), done.stderr.rstrip()

    def calls(self) -> list[str]:
        return (self.home / "calls").read_text().splitlines()


@pytest.fixture
def computer(tmp_path) -> Computer:
    return Computer(tmp_path)


@pytest.fixture
def slim(computer) -> Computer:
    """Debian with neither venv nor libraries."""
    computer.has("apt-get", APT_GET)
    computer.lacks("libGL.so.1 libgl1\nlibusb-1.0.so.0 libusb-1.0-0\n")
    (computer.home / "no-venv").touch()
    return computer


def test_nothing_is_missing(computer):
    assert computer.run("system") == (0, "python3", "")


def test_who_may_not_install_gets_the_command_in_one_line(slim):
    line = (
        "beemap: missing: venv of python3, libGL.so.1, libusb-1.0.so.0: as root, run "
        f"'apt-get update && apt-get install -y {VENV_PACKAGE} libgl1 libusb-1.0-0'"
    )
    assert slim.run("system") == (2, "", line)
    slim.has("sudo", "exit 1")  # it would ask for a password
    line = line.replace("as root, ", "").replace("apt-get ", "sudo apt-get ")
    assert slim.run("system") == (2, "", line)
    assert not (slim.home / "calls").exists()


@pytest.mark.parametrize("who", ["root", "sudo"])
def test_who_may_install_gets_what_is_missing(slim, who):
    slim.has("id", "echo 0" if who == "root" else "echo 1000")
    slim.has("sudo", '[ "$1" = -n ] && shift && exec "$@"')
    code, out, err = slim.run("system")
    packages = f"{VENV_PACKAGE} libgl1 libusb-1.0-0"
    assert (code, out, err) == (0, "python3", f"Installing with apt-get: {packages}")
    failed, update, install = slim.calls()
    assert "update" in update
    assert install == failed
    assert install.endswith(f"install -y --no-install-recommends {packages}")
    assert slim.run("system") == (0, "python3", "")
    assert len(slim.calls()) == 3


def test_what_cannot_be_installed_is_one_line(slim):
    slim.has("id", "echo 0")
    slim.has("apt-get", "echo 'E: no network' >&2; exit 100")
    code, out, err = slim.run("system")
    assert (code, out) == (2, "")
    line = (
        "beemap: missing: venv of python3, libGL.so.1, libusb-1.0.so.0; apt-get could not install "
        f"them (E: no network): run 'apt-get update && apt-get install -y {VENV_PACKAGE} libgl1 "
        "libusb-1.0-0'"
    )
    assert err.splitlines()[1:] == [line]


@pytest.mark.parametrize(
    ("manager", "command"),
    [
        ("dnf", "run \"dnf install -y 'libX.so.6()(64bit)'\""),
        ("pacman", "run 'pacman -Sy --needed libX.so.6()(64bit)'"),
        ("none", "install what holds them with the system's package manager"),
    ],
)
def test_other_distributions_are_told_their_own_command(computer, manager, command):
    computer.has(manager, "exit 1")
    computer.lacks("libX.so.6 libX.so.6()(64bit)\n")
    line = f"beemap: missing: libX.so.6: as root, {command}"
    assert computer.run("system") == (2, "", line)


def test_a_fitting_python_is_found_by_itself(computer):
    computer.has("python3", OLD)
    code, _, err = computer.run("system")
    assert code == 2
    assert err.startswith("beemap: missing: Python 3.11 to 3.14 (python3 is 3.9.2)")
    computer.has("python3.12", "exec {python} " + '"$@"')
    assert computer.run("system") == (0, "python3.12", "")
    line = (
        "beemap: PYTHON=python3 is 3.9.2, not Python 3.11 to 3.14: name another one, as in "
        "'make demo PYTHON=python3.12'"
    )
    assert computer.run("system", "python3") == (2, "", line)


def test_a_python_with_venv_is_taken_before_one_without(slim):
    slim.lacks("")
    slim.has("python3.13", "exec {python} " + '"$@"')
    assert slim.run("system") == (0, "python3.13", "")


def test_a_python_is_installed_where_none_fits(slim):
    slim.has("id", "echo 0")
    slim.has("python3", OLD)
    slim.has("apt-cache", "[ ! -e {home}/lists ] || echo python3.12-venv")
    slim.has("apt-get", APT_GET + "echo 'exec {python} \"$@\"' >{home}/bin/python3.12\n")
    (slim.home / "bin" / "python3.12").touch(0o755)
    code, out, _ = slim.run("system")
    assert (code, out) == (0, "python3.12")


# A virtual environment in which pip notes what it was asked for.
VENV = """
case "$*" in
  "-m venv "*) mkdir -p "$3/bin"; cp {home}/pip "$3/bin/python" ;;
  *) exec {python} "$@" ;;
esac
"""
PIP = '#!/bin/sh\necho "$*" >>{home}/calls\n[ ! -e {home}/offline ] || exit 1\n'


def test_an_interrupted_installation_is_made_anew(computer):
    home = computer.home
    (home / "bin" / "cp").symlink_to(shutil.which("cp") or "")
    computer.has("python3", VENV)
    (home / "pip").write_text(PIP.replace("{home}", str(home)))
    (home / "pip").chmod(0o755)
    (home / "offline").touch()
    assert computer.run("install", ".venv")[0] != 0
    assert not (home / ".venv" / "installed").exists()
    (home / ".venv" / "half").touch()
    (home / "offline").unlink()
    assert computer.run("install", ".venv")[0] == 0
    assert (home / ".venv" / "installed").exists()
    assert not (home / ".venv" / "half").exists()
    # One that is whole is kept.
    (home / ".venv" / "mine").touch()
    assert computer.run("install", ".venv", "dev")[0] == 0
    assert (home / ".venv" / "installed-dev").exists()
    assert (home / ".venv" / "mine").exists()
    assert computer.calls()[-1].endswith("-c constraints.txt --no-build-isolation -e .[dev]")
    assert computer.run("install", ".venv", "dev", NEWEST="1")[0] == 0
    assert "constraints" not in computer.calls()[-1]


# machine.py


@pytest.fixture
def machine(monkeypatch):
    spec = importlib.util.spec_from_file_location("machine", CI / "machine.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(platform, "system", lambda: "Linux")
    monkeypatch.setattr(platform, "machine", lambda: "x86_64")
    monkeypatch.setattr(platform, "libc_ver", lambda: ("glibc", "2.36"))
    return module


def test_libraries_are_looked_for_as_the_loader_does(machine, monkeypatch):
    def load(name: str) -> None:
        if name in ("libEGL.so.1", "libgomp.so.1"):
            raise OSError(f"{name}: cannot open shared object file")

    monkeypatch.setattr(ctypes, "CDLL", load)
    found = machine.missing()
    assert {name: machine.package("apt-get", name, found[name]) for name in found} == {
        "libgomp.so.1": "libgomp1",
        "libEGL.so.1": "libegl1",
    }
    assert machine.package("dnf", "libEGL.so.1", found["libEGL.so.1"]) == "libEGL.so.1()(64bit)"
    # An older glibc has no Open3D, which thus needs nothing.
    monkeypatch.setattr(platform, "libc_ver", lambda: ("glibc", "2.34"))
    assert set(machine.missing()) == {"libgomp.so.1"}


def test_where_open3d_has_no_wheel_the_rest_is_installed(machine, monkeypatch):
    project = CI.parent / "pyproject.toml"
    whole = machine.requirements(project)
    assert any(line.startswith("open3d-cpu") for line in whole)
    monkeypatch.setattr(platform, "libc_ver", lambda: ("glibc", "2.34"))
    rest = machine.requirements(project)
    assert [line for line in whole if not line.startswith("open3d")] == rest
    assert any(line.startswith("numba") for line in rest)


def test_machines_without_any_wheels_are_named(machine, monkeypatch):
    assert machine.unsupported() == ""
    monkeypatch.setattr(sysconfig, "get_config_var", lambda name: "cpython-312-x86_64-linux-musl")
    assert "musl" in machine.unsupported()
    monkeypatch.setattr(struct, "calcsize", lambda form: 4)
    assert "64-bit" in machine.unsupported()


def test_messages_of_the_mapper_name_the_same_packages(machine):
    assert SYSTEM_LIBRARIES.split() == [packages[0] for packages in machine.OPEN3D.values()]
    assert ".".join(map(str, machine.OPEN3D_GLIBC)) == GLIBC
