"""Which cameras a rig has: the camera part of `devices:` in rig.yaml, checked."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Annotated, Any
from urllib.parse import urlsplit

import msgspec

from stereo.errors import StereoError

# Two cameras whose images lie further apart than this share of a period could be paired wrongly.
MOST_SKEW = 0.45

Positive = Annotated[float, msgspec.Meta(gt=0)]
Side = Annotated[int, msgspec.Meta(ge=16, le=16384)]


class CameraSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Two cameras, or one that sends both images side by side.

    left, right, stereo: `/dev/video0`, its number, or the `http://` address of an MJPEG stream.
    size: (width, height) of one camera's image [px]; None: whatever the camera sends.
    fps: pairs a second asked of the cameras. exposure: fixed [ms]; None: automatic.
    max_skew: images taken further apart are no pair [ms].
    """

    left: str | int | None = None
    right: str | int | None = None
    stereo: str | int | None = None
    size: tuple[Side, Side] | None = None
    fps: Positive = 10.0
    exposure: Positive | None = None
    max_skew: Positive = 20.0

    @property
    def addresses(self) -> dict[str, str | int]:
        """Name of a camera -> its device or address; in the order left, right, or one alone."""
        named = {"left": self.left, "right": self.right, "stereo": self.stereo}
        return {name: address for name, address in named.items() if address is not None}

    @property
    def one_host(self) -> bool:
        """Whether both cameras are streams of one machine, which has one clock."""
        hosts = [
            urlsplit(str(address)).hostname if is_network(address) else None
            for address in (self.left, self.right)
            if address is not None
        ]
        return len(hosts) == 2 and hosts[0] is not None and hosts[0] == hosts[1]

    @property
    def period(self) -> int:
        """Time between two pairs [ns]."""
        return round(1e9 / self.fps)

    @property
    def skew_limit(self) -> int:
        """Most time between the images of a pair [ns]."""
        return round(min(self.max_skew * 1e6, MOST_SKEW * self.period))


CAMERA_KEYS = CameraSettings.__struct_fields__


def camera_settings(devices: Mapping[str, Any], source: str) -> CameraSettings:
    """The cameras among the `devices` of a rig; keys of other devices are passed over.

    Raises:
        StereoError: no camera, one camera alone, or a wrong value; `source` is named.
    """
    chosen = {key: value for key, value in devices.items() if key in CAMERA_KEYS}
    try:
        settings = msgspec.convert(chosen, CameraSettings)
    except msgspec.ValidationError as error:
        message, _, place = str(error).partition(" - at ")
        key = place.strip("`").removeprefix("$.").partition("[")[0]
        raise StereoError(f"{source}: devices.{key} is {chosen.get(key)!r}: {message}") from None
    if not settings.addresses:
        raise StereoError(
            f"{source}: devices names no camera: give left and right, or stereo for one that "
            "sends both images side by side"
        )
    if settings.stereo is None and len(settings.addresses) == 1:
        (only,) = settings.addresses
        other = "right" if only == "left" else "left"
        raise StereoError(f"{source}: devices.{other} is missing: a stereo rig has two cameras")
    if settings.stereo is not None and len(settings.addresses) > 1:
        raise StereoError(f"{source}: devices: give left and right, or stereo, not both")
    if settings.stereo is None and settings.left == settings.right:
        raise StereoError(f"{source}: devices.left and right are both {settings.left!r}")
    for name, address in settings.addresses.items():
        _check_address(address, f"{source}: devices.{name}")
    return settings


def is_network(address: str | int) -> bool:
    """Whether it is the address of a stream and no device of this machine."""
    return isinstance(address, str) and "://" in address


def _check_address(address: str | int, where: str) -> None:
    if isinstance(address, int):
        if address < 0:
            raise StereoError(f"{where}: {address}: give the number of a /dev/video device")
        return
    if not is_network(address):
        if not re.fullmatch(r"/dev/\S+", address):
            raise StereoError(
                f"{where}: {address!r}: give /dev/video0, its number, or http://HOST/STREAM"
            )
        return
    try:
        parts = urlsplit(address)
        good = parts.scheme == "http" and bool(parts.hostname) and parts.port != 0
    except ValueError:
        good = False
    if not good:
        raise StereoError(f"{where}: {address!r}: give http://HOST:PORT/STREAM of an MJPEG stream")
