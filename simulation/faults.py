"""CameraFaults: what is wrong with the two cameras, each fault off unless told, but the noise.

The order in which they act: shutter, readout and skew on where and when the light falls;
vignetting and defocus on the light; exposure, noise, gain, the tone curve and JPEG in the sensor.
"""

from __future__ import annotations

import math
import typing
from collections.abc import Iterable, Iterator
from typing import Annotated, Any

import msgspec


class FaultError(ValueError):
    """A fault that no camera has; the message names the fault, the value and the remedy."""


def _meta(description: str, unit: str, **limits: Any) -> msgspec.Meta:
    return msgspec.Meta(description=description, extra={"unit": unit}, **limits)


class CameraFaults(msgspec.Struct, frozen=True):
    """How the cameras spoil the light that reaches them.

    Raises:
        FaultError: a value that is not a number within its limits.
    """

    exposure_left: Annotated[
        float, _meta("light the left camera gathers", "times", ge=0.01, le=100)
    ] = 1.0
    exposure_right: Annotated[float, _meta("of the right camera", "times", ge=0.01, le=100)] = 1.0
    gain_left: Annotated[
        float, _meta("amplifies the left camera's light and noise", "times", ge=0.01, le=100)
    ] = 1.0
    gain_right: Annotated[float, _meta("of the right camera", "times", ge=0.01, le=100)] = 1.0
    vignetting: Annotated[
        float, _meta("darker towards the edges: 1 is a lens's cos^4 of the angle", "", ge=0, le=4)
    ] = 0.0
    defocus: Annotated[float, _meta("standard deviation of the blur", "px", ge=0, le=20)] = 0.0
    noise: Annotated[
        float, _meta("noise of photons and read-out; 1: of a small sensor", "times", ge=0, le=50)
    ] = 1.0
    shutter: Annotated[
        float, _meta("time open, the stamp in its middle: motion blur", "s", ge=0, le=0.5)
    ] = 0.0
    readout: Annotated[
        float, _meta("first to last row, the stamp in its middle: rolling", "s", ge=0, le=0.5)
    ] = 0.0
    skew: Annotated[
        float, _meta("the right camera's delay behind the left", "s", ge=-0.5, le=0.5)
    ] = 0.0
    jpeg: Annotated[
        int, _meta("quality of the stream the camera sends; 0: not compressed", "%", ge=0, le=100)
    ] = 0

    def __post_init__(self) -> None:
        for name, meta in _metas().items():
            low, high = meta.ge, meta.le
            value = getattr(self, name)
            assert isinstance(low, (int, float))
            assert isinstance(high, (int, float))
            if not _is_number(value) or not low <= value <= high:
                raise FaultError(
                    f"fault {name} is {value!r}: give {low:g} to {high:g}"
                    + _unit(meta, " ")
                    + f" ({meta.description})"
                )


def with_faults(faults: CameraFaults, changes: Iterable[str]) -> CameraFaults:
    """`faults` with every change, written as NAME=VALUE.

    Raises:
        FaultError: an unknown name, or a value that is no number or out of its limits.
    """
    values: dict[str, Any] = {}
    for change in changes:
        name, equals, text = (part.strip() for part in change.partition("="))
        if name not in CameraFaults.__struct_fields__ or not equals:
            known = ", ".join(CameraFaults.__struct_fields__)
            raise FaultError(f"fault '{change}': write NAME=VALUE (known: {known})")
        kind = type(getattr(faults, name))
        try:
            values[name] = kind(text)
        except ValueError:
            wanted = "a whole number" if kind is int else "a number"
            raise FaultError(f"fault {name} is '{text}': give {wanted}") from None
    return msgspec.structs.replace(faults, **values)


def described() -> Iterator[tuple[str, str, str]]:
    """(name, unit, meaning) of every fault."""
    for name, meta in _metas().items():
        yield name, _unit(meta), meta.description or ""


def _metas() -> dict[str, msgspec.Meta]:
    hints = typing.get_type_hints(CameraFaults, include_extras=True)
    return {name: hints[name].__metadata__[0] for name in CameraFaults.__struct_fields__}


def _unit(meta: msgspec.Meta, before: str = "") -> str:
    unit = (meta.extra or {}).get("unit", "")
    return before + unit if unit else ""


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


PLAIN = CameraFaults()
# Cameras as bundles of faults.
CAMERAS = {
    "plain": PLAIN,
    "cheap": CameraFaults(
        exposure_left=1.05, exposure_right=0.95, vignetting=0.6, noise=1.5, jpeg=85
    ),
}
