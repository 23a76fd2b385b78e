"""What the benchmarks share: the recording, and a run of the command line."""

from __future__ import annotations

import json
import subprocess
import sys
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
