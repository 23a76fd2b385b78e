"""The pages of docs/ taken apart: blocks of commands, of Python and of YAML, in their order."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parent.parent
PAGES = sorted((ROOT / "docs").glob("*.md"))
LANGUAGES = ("sh", "python", "yaml", "text", "html", "json")
TERMINAL = "# one terminal"


@dataclass(frozen=True)
class Block:
    """A fenced block: its language, its text, the line it begins at."""

    language: str
    text: str
    line: int

    def commands(self) -> list[list[str]]:
        """The words of each command; lines that end with a backslash are joined."""
        joined = self.text.replace("\\\n", " ")
        words = [shlex.split(line, comments=True) for line in joined.splitlines()]
        return [line for line in words if line]

    @property
    def background(self) -> bool:
        """Whether it runs in a terminal of its own, beside the rest of the page."""
        return self.text.startswith(TERMINAL)


def blocks(page: Path) -> list[Block]:
    """The fenced blocks of a page."""
    found = []
    text = page.read_text(encoding="utf-8")
    for match in re.finditer(r"^```(\w*)\n(.*?)^```$", text, re.MULTILINE | re.DOTALL):
        found.append(Block(match[1], match[2], text.count("\n", 0, match.start()) + 1))
    return found
