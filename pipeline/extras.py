"""Libraries that only an extra of the package brings: beemap[web], [view], [ros], [cluster]."""

from __future__ import annotations

import importlib

from pipeline.errors import InputError

# extra -> the modules it must bring, as pyproject.toml lists them.
MODULES = {
    "web": ("starlette", "uvicorn", "websockets"),
    "view": ("rerun",),
    "ros": ("rosbags",),
    "cluster": ("distributed",),
}


def need(extra: str, what: str) -> None:
    """Make sure that the libraries of an extra are there, before anything is begun.

    what: the command or option that needs them, as the user wrote it ("--scheduler").

    Raises:
        InputError: one of them is not installed; the line says what to install.
    """
    for module in MODULES[extra]:
        try:
            importlib.import_module(module)
        except ModuleNotFoundError as error:
            raise InputError(
                f"{what}: needs {error.name or module}: pip install 'beemap[{extra}]'"
            ) from error
