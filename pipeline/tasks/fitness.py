"""Are the workers of a cluster fit for our tasks: the same beemap, the same files?"""

from __future__ import annotations

import platform
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from pipeline.tasks import identity as identity_module
from pipeline.tasks.identity import identity

# Of this process as it was when first asked: files that change later are not what it has loaded.
own_identity = cache(identity)


def judge(client: Any, must_see: Sequence[Path]) -> tuple[dict[str, str], set[str]]:
    """Address -> what is wrong, in words, of the workers that are not fit; and the addresses of
    those that are. A worker that ends while it is asked is neither.

    Python first, as nothing can be asked of another one; then beemap; then the files.
    """
    here = _minor(platform.python_version())
    pythons = {
        worker: _minor(told["host"]["python"])
        for worker, told in client.get_versions()["workers"].items()
    }
    if faults := _faults({w: {"Python": p} for w, p in pythons.items()}, {"Python": here}):
        return faults, set()
    if faults := _faults(_identities(client), own_identity()):
        return faults, set()
    unseen = _answers(client, _unseen, [str(file) for file in must_see])
    faults = {
        worker: f"does not see {file}: its paths must be the same (a shared folder)"
        for worker, file in unseen.items()
        if file is not None
    }
    return faults, unseen.keys() - faults.keys()


def misfit(theirs: Mapping[str, str], ours: Mapping[str, str]) -> str | None:
    """The first version that is not the same, and the remedy; None: all are."""
    for name, mine in ours.items():
        if theirs[name] != mine:
            return (
                f"has {name} {theirs[name]}, here {mine}: install the same there and start the "
                "worker again"
            )
    return None


def _faults(found: Mapping[str, Mapping[str, str]], ours: Mapping[str, str]) -> dict[str, str]:
    faults = {worker: misfit(theirs, ours) for worker, theirs in found.items()}
    return {worker: fault for worker, fault in faults.items() if fault is not None}


def _minor(version: str) -> str:
    """3.12 of 3.12.3."""
    return ".".join(version.split(".")[:2])


def _identities(client: Any) -> dict[str, dict[str, str]]:
    import cloudpickle

    # By value: a worker's own copy of that function may be missing, or tell something else.
    cloudpickle.register_pickle_by_value(identity_module)
    try:
        return _answers(client, identity)
    finally:
        cloudpickle.unregister_pickle_by_value(identity_module)


def _answers(client: Any, function: Callable[..., Any], *arguments: Any) -> dict[str, Any]:
    """Address -> function(*arguments) there, of all workers that are still there."""
    found = client.run(function, *arguments, on_error="return")
    for answer in found.values():
        if isinstance(answer, Exception) and not isinstance(answer, OSError):
            raise answer
    return {w: answer for w, answer in found.items() if not isinstance(answer, OSError)}


def _unseen(files: list[str]) -> str | None:
    """The first of the files that this process does not see."""
    return next((file for file in files if not Path(file).exists()), None)
