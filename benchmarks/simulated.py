"""The experiments of `beemap experiment`, with few enough seeds for twenty minutes.

Begun folders are gone on with; more seeds: the command that stands in each table, with more.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

from pipeline.experiments.report import machine

FOLDER = Path("experiments")
FIGURES = Path("docs/experiments")
# What the tables of the page say of the paper's claims; to be read again when they change.
READING = """### What holds of the paper's claims

- *Less time*: holds; at the same N the previous method takes several times the processor time.
- *A better map*: depends on the ideal. Against the common ideal the hierarchical method is worse
  (its cells stay further from 0 and 1), against that ideal cut at .7 / .2 about equal with fewer
  cells decided, against each mapper's own perfect-sensor map better with raw odometry, as with
  matched ego-motion.
- *Robust against worse stereo*: holds, and is what remains when both methods get matched
  ego-motion: with false depths that stand (`replace`), and most with four false blocks a frame, the
  previous method's mean path error is several times the hierarchical one's.
- With the paper's own settings the hierarchical method has the better median path but lost one run
  in nine, the previous method none; with matched ego-motion it lost none.
- The filter's spread is too small for its errors (NEES): each scan is used for ego-motion and again
  for weighing."""
# name -> seeds, jobs. Where time is measured nothing else may run.
EXPERIMENTS = {
    "table": ("--seeds", "9", "--jobs", "2"),
    "particles": ("--seeds", "1", "--jobs", "1"),
    "localmaps": (),
    "office": ("data/office", "--force"),
    "maps": ("--seeds", "1", "--jobs", "1"),
}


def main(folder: Path = FOLDER) -> str:
    """Run what is missing in `folder`; the section as Markdown, its figures in docs/experiments."""
    FIGURES.mkdir(parents=True, exist_ok=True)
    parts = ["## The paper's experiments: `python -m benchmarks.simulated`", f"{machine()}."]
    for name, options in EXPERIMENTS.items():
        output = folder / name
        command = [sys.executable, "-m", "pipeline.cli", "experiment", name, "-o", str(output)]
        subprocess.run([*command, *options], check=True)
        parts.append(_demoted((output / "table.md").read_text(encoding="utf-8")))
        for figure in sorted(output.glob("*.png")):
            kept = FIGURES / f"{name}-{figure.name}"
            shutil.copyfile(figure, kept)
            parts.append(f"![{name}: {figure.stem}]({kept})")
    parts.append(READING)
    parts.append(
        "Not on this page, with their commands: `beemap experiment quality` (Fig. 8), `readings`, "
        "`cost` (against area and length, and threads)."
    )
    return "\n\n".join(parts)


def _demoted(page: str) -> str:
    """A page as a part of another: its headings two levels lower, its figures left to `main`."""
    lines = [line for line in page.strip().splitlines() if not line.startswith("![")]
    return "\n".join(f"##{line}" if line.startswith("#") else line for line in lines)


if __name__ == "__main__":
    print(main())
