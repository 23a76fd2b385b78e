"""Check: one thing that was looked at, and what to do about it."""

from __future__ import annotations

from dataclasses import dataclass

PASS, WARN, FAIL = "PASS", "WARN", "FAIL"


@dataclass(frozen=True)
class Check:
    """status: PASS, WARN or FAIL; found: in words; remedy: what to do, "" when nothing."""

    name: str
    status: str
    found: str
    remedy: str = ""

    @property
    def line(self) -> str:
        """As it is printed."""
        remedy = f": {self.remedy}" if self.remedy else ""
        return f"{self.status}  {self.name:<12} {self.found}{remedy}"


def failed(name: str, error: Exception) -> Check:
    """A check that an error ended; its message ends with the remedy."""
    return Check(name, FAIL, " ".join(str(error).split()))
