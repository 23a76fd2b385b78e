"""What the benchmarks share: a run of the command line, the machine's name, Markdown tables."""

from __future__ import annotations

import json
import os
import platform
import subprocess
import sys
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

OFFICE = Path("data/office")
IDEAL = OFFICE / "truth" / "seen.yaml"


def map_recording(recording: Path, output: Path, *options: str) -> dict[str, Any]:
    """Run `beemap map` as a process of its own; the content of run.json.

    Raises subprocess.CalledProcessError when it fails.
    """
    command = [sys.executable, "-m", "pipeline.cli", "map", str(recording), "-o", str(output)]
    subprocess.run([*command, "--force", "--quiet", *options], check=True)
    return json.loads((output / "run.json").read_text(encoding="utf-8"))


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table; the first column is text, the others are numbers."""
    rule = ["---", *["---:"] * (len(header) - 1)]
    return "\n".join("| " + " | ".join(row) + " |" for row in (header, rule, *rows))


def machine() -> str:
    """Processor, cores, Python and the libraries that the time depends on, in one line."""
    libraries = ", ".join(
        f"{label} {version(name)}"
        for label, name in (
            ("OpenCV", "opencv-contrib-python-headless"),
            ("numpy", "numpy"),
            ("numba", "numba"),
        )
    )
    return (
        f"{_processor()}, {os.cpu_count()} cores, {platform.system()}; "
        f"Python {platform.python_version()}, {libraries}"
    )


def _processor() -> str:
    """The model as the kernel of Linux names it, else the platform's own name."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()
