"""`python -m benchmarks FILE`: run every benchmark and write what they print into FILE."""

from __future__ import annotations

import sys
from pathlib import Path

from benchmarks import (
    accuracy,
    batch,
    calibration,
    consistency,
    end_to_end,
    first_map,
    live,
    logs,
    memory,
    serial_faults,
    simulated,
    stereo_columns,
    stereo_end_to_end,
    stereo_floor,
    stereo_model,
    stereo_pictures,
    stereo_rendered,
    stereo_rows,
    stereo_time,
    stereo_walls,
    visual,
    web,
    wheel_calibration,
)

TITLE = "# Benchmarks\n\nThis page is written by `make bench`, from the repository's root."

stereo = (
    stereo_pictures,
    stereo_columns,
    stereo_rendered,
    stereo_floor,
    stereo_walls,
    stereo_rows,
    stereo_time,
    stereo_model,
    stereo_end_to_end,
)
encoders = (serial_faults, wheel_calibration, live, web, batch)
sections = (
    first_map,
    end_to_end,
    accuracy,
    *stereo,
    visual,
    consistency,
    logs,
    memory,
    calibration,
    *encoders,
    simulated,
)
page = "\n\n".join([TITLE, *(section.main() for section in sections)]) + "\n"
print(page)
Path(sys.argv[1]).write_text(page, encoding="utf-8")
