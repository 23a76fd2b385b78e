"""Plots as inline SVG: thin, of few words, in the colours of the page (see base.html.j2).

A page styles them by class: `line` and `dot` with a colour's name (blue, orange, ok, bad, soft),
`limit`, `axis`, `tick`. Their units are those of a phone's screen, where they are shown as they
are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from markupsafe import escape

WIDTH, HEIGHT = 360, 150
LEFT, RIGHT, TOP, BOTTOM = 42, 10, 10, 34
# More points than this are no more than a screen shows.
MOST_POINTS = 400


@dataclass
class Plot:
    """A plot of y over x; `svg` when all is drawn.

    x, y: the ranges shown; label: what it is, for those who cannot see it; across: what x is.
    """

    x: tuple[float, float]
    y: tuple[float, float]
    label: str
    across: str
    parts: list[str] = field(default_factory=list)

    def ticks(self, values: Sequence[float], names: Sequence[str]) -> None:
        """Lines across at values of y, with names at the left."""
        for value, name in zip(values, names, strict=True):
            v = self._v(value)
            self.parts.append(
                f'<path class="axis" d="M{LEFT} {v:.1f}H{WIDTH - RIGHT}"/>'
                f'<text class="tick" x="{LEFT - 5}" y="{v + 4:.1f}" text-anchor="end">'
                f"{escape(name)}</text>"
            )

    def limit(self, value: float, name: str) -> None:
        """A broken line across at a value of y that means something."""
        v = self._v(value)
        self.parts.append(
            f'<path class="limit" d="M{LEFT} {v:.1f}H{WIDTH - RIGHT}"/>'
            f'<text class="tick halo" x="{LEFT + 4}" y="{v - 4:.1f}">{escape(name)}</text>'
        )

    def line(self, x: np.ndarray, y: np.ndarray, colour: str) -> None:
        """A line through points (n,), with a dot where there is but one."""
        if len(x) == 1:
            self.dots(x, y, [colour])
            return
        points = " ".join(f"{self._u(a):.1f},{self._v(b):.1f}" for a, b in zip(x, y, strict=True))
        self.parts.append(f'<polyline class="line {colour}" points="{points}"/>')

    def dots(
        self, x: np.ndarray, y: np.ndarray, colours: Sequence[str], titles: Sequence[str] = ()
    ) -> None:
        """A dot at each point (n,); a title tells more where the mouse rests."""
        for number, (a, b, colour) in enumerate(zip(x, y, colours, strict=True)):
            title = f"<title>{escape(titles[number])}</title>" if titles else ""
            self.parts.append(
                f'<circle class="dot {colour}" cx="{self._u(a):.1f}" cy="{self._v(b):.1f}" r="3">'
                f"{title}</circle>"
            )

    def marks(self, x: np.ndarray, colour: str) -> None:
        """Short strokes on the axis below."""
        bottom = HEIGHT - BOTTOM
        strokes = "".join(f"M{self._u(a):.1f} {bottom}v6" for a in x)
        if strokes:
            self.parts.append(f'<path class="line {colour}" d="{strokes}"/>')

    @property
    def svg(self) -> str:
        """The whole, as an element for a page."""
        bottom = HEIGHT - BOTTOM
        axis = [f'<path class="axis base" d="M{LEFT} {bottom}H{WIDTH - RIGHT}"/>']
        for value in round_steps(*self.x, 6):
            axis.append(
                f'<text class="tick" x="{self._u(value):.1f}" y="{bottom + 18}" '
                f'text-anchor="middle">{value:g}</text>'
            )
        axis.append(
            f'<text class="tick" x="{WIDTH - RIGHT}" y="{HEIGHT - 3}" text-anchor="end">'
            f"{escape(self.across)}</text>"
        )
        return (
            f'<svg class="plot" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" '
            f'aria-label="{escape(self.label)}">{"".join([*axis, *self.parts])}</svg>'
        )

    def _u(self, x: float) -> float:
        low, high = self.x
        return LEFT + (x - low) / max(high - low, 1e-9) * (WIDTH - LEFT - RIGHT)

    def _v(self, y: float) -> float:
        low, high = self.y
        return HEIGHT - BOTTOM - (y - low) / (high - low) * (HEIGHT - TOP - BOTTOM)


def round_steps(low: float, high: float, most: int) -> list[float]:
    """At most so many round numbers from `low` to `high`."""
    span = max(high - low, 1e-9)
    for power in range(-6, 9):
        for step in (1.0, 2.0, 5.0):
            size = step * 10.0**power
            first = np.ceil(low / size - 1e-9)
            count = int(np.floor(high / size + 1e-9) - first) + 1
            if span / size <= most and count <= most:
                return [round(float((first + k) * size), 6) for k in range(count)]
    return [low, high]


def thinned(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of more than `MOST_POINTS` points (n,) the lowest of each of so many neighbours."""
    if len(x) <= MOST_POINTS:
        return x, y
    parts = np.array_split(np.arange(len(x)), MOST_POINTS)
    lowest = [part[np.argmin(y[part])] for part in parts]
    return x[lowest], y[lowest]


def way(points: np.ndarray, most: int = 2000) -> str:
    """Points (n, 2) as the path data of one stroke, of many a part."""
    if len(points) > most:
        points = points[np.linspace(0, len(points) - 1, most).astype(int)]
    return "M" + "L".join(f"{x:.3f} {y:.3f}" for x, y in points) if len(points) else ""
