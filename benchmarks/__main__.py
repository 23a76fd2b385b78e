"""`python -m benchmarks FILE`: run every benchmark and write what they print into FILE."""

from __future__ import annotations

import sys
from pathlib import Path

from benchmarks import accuracy, end_to_end, logs, simulated

TITLE = "# Benchmarks\n\nThis page is written by `make bench`, from the repository's root."

page = (
    "\n\n".join([TITLE, end_to_end.main(), accuracy.main(), logs.main(), simulated.main()]) + "\n"
)
print(page)
Path(sys.argv[1]).write_text(page, encoding="utf-8")
