"""Which topic of a bag is what: named by the user, or guessed by type and name."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass

from pipeline.errors import InputError
from pipeline.ros.bags import Topic
from pipeline.ros.types import CAMERA_INFO, COMPRESSED, IMAGE, JOINTS, ODOMETRY, OLD_TF, TF

# What the two cameras are called, the surest first.
SIDES = (("left", "right"), ("infra1", "infra2"), ("l", "r"), ("0", "1"), ("1", "2"))
# Images that are no photographs.
NO_PHOTO = re.compile(r"depth|disparity|confidence|mask|debug|theora|overlay|label")
# Odometry that is not the wheels' alone.
NO_WHEELS = re.compile(r"filter|fused|ekf|visual|vio|vslam|gps|truth|slam|icp|lidar|laser")
RECTIFIED = re.compile(r"(^|[/_])rect")


@dataclass(frozen=True)
class Named:
    """What the user named, each None where it is to be guessed."""

    left: str | None = None
    right: str | None = None
    left_info: str | None = None
    right_info: str | None = None
    odometry: str | None = None
    joints: str | None = None


@dataclass(frozen=True)
class Chosen:
    """The topics to be read; None: there is none."""

    left: Topic
    right: Topic
    left_info: Topic | None
    right_info: Topic | None
    odometry: Topic | None
    joints: Topic | None
    transforms: tuple[Topic, ...]

    @property
    def rectified(self) -> bool:
        """Whether the images are called rectified (image_rect, image_rect_color, ...)."""
        return all(RECTIFIED.search(_stem(t.name).rpartition("/")[2]) for t in self.cameras)

    @property
    def cameras(self) -> tuple[Topic, Topic]:
        """Left, right."""
        return self.left, self.right


def choose(topics: Mapping[str, Topic], named: Named, bag: str) -> Chosen:
    """What the user named, and the likeliest of the others.

    Raises:
        InputError: no such topic, one of another type, or no pair of image topics; those that are
            there are listed with their types.
    """
    left = _named(topics, "left", named.left, (IMAGE, COMPRESSED), bag)
    right = _named(topics, "right", named.right, (IMAGE, COMPRESSED), bag)
    left, right = _cameras(topics, left, right, bag)
    left_info = _named(topics, "left-info", named.left_info, (CAMERA_INFO,), bag)
    right_info = _named(topics, "right-info", named.right_info, (CAMERA_INFO,), bag)
    odometry = _named(topics, "odom", named.odometry, (ODOMETRY,), bag)
    joints = _named(topics, "joints", named.joints, (JOINTS,), bag)
    return Chosen(
        left,
        right,
        left_info or _info(topics, left),
        right_info or _info(topics, right),
        odometry or _odometry(topics),
        joints or _most([t for t in topics.values() if t.type == JOINTS]),
        tuple(t for t in topics.values() if t.type in (TF, OLD_TF)),
    )


def listed(topics: Mapping[str, Topic]) -> str:
    """As in `/left/image_raw (sensor_msgs/Image), /odom (nav_msgs/Odometry)`."""
    told = [f"{t.name} ({short(t.type)})" for t in sorted(topics.values(), key=lambda t: t.name)]
    return ", ".join(told) or "none"


def short(kind: str) -> str:
    """`sensor_msgs/Image` of `sensor_msgs/msg/Image`."""
    return kind.replace("/msg/", "/")


def _named(
    topics: Mapping[str, Topic], option: str, name: str | None, kinds: tuple[str, ...], bag: str
) -> Topic | None:
    if name is None:
        return None
    # image_transport's way to name one stream: the topic without what packs it.
    found = topics.get(name) or topics.get(f"{name}/compressed")
    there = listed({t.name: t for t in topics.values() if t.type in kinds} or topics)
    if found is None:
        raise InputError(f"--{option} {name}: no such topic in {bag} (there are: {there})")
    if found.type not in kinds:
        wanted = " or ".join(short(kind) for kind in kinds)
        raise InputError(
            f"--{option} {name}: is {short(found.type)}, needed is {wanted} (there are: {there})"
        )
    return found


def _cameras(
    topics: Mapping[str, Topic], left: Topic | None, right: Topic | None, bag: str
) -> tuple[Topic, Topic]:
    if left is not None and right is not None:
        if left == right:
            raise InputError(f"--right {right.name}: is the left camera's topic: give the other")
        return left, right
    photos = {
        t.name: t
        for t in topics.values()
        if t.type in (IMAGE, COMPRESSED) and t.count and not NO_PHOTO.search(t.name.lower())
    }
    pairs = []
    for a in photos.values():
        for order, sides in enumerate(SIDES):
            b = photos.get(_other(a.name, *sides) or "")
            if b is not None and left in (None, a) and right in (None, b):
                pairs.append((_likeliness(a, b, order), a, b))
    if not pairs:
        missing = "--left and --right" if left is right else "--right" if left else "--left"
        raise InputError(
            f"{bag}: no two image topics that are called left and right: name them with {missing} "
            f"(there are: {listed(topics)})"
        )
    _, a, b = min(pairs, key=lambda pair: pair[0])
    return a, b


def _other(name: str, left: str, right: str) -> str | None:
    """The name with `right` wherever it says `left`; None: it does not."""
    # A number ends a word (cam0); a word stands alone (left_camera).
    letters = "0-9" if left.isdigit() else "a-z0-9"
    other, count = re.subn(f"(?<![{letters}]){left}(?![{letters}])", right, name)
    return other if count else None


def _likeliness(a: Topic, b: Topic, order: int) -> tuple[int, bool, int, bool, int, str]:
    """The least is the likeliest pair: surest names, raw, most images, without loss."""
    name = _stem(a.name).rpartition("/")[2]
    count = min(a.count, b.count)
    return order, bool(RECTIFIED.search(name)), -count, a.type == COMPRESSED, len(name), a.name


def _stem(name: str) -> str:
    """The image topic without what packs it."""
    return name.removesuffix("/compressed")


def _info(topics: Mapping[str, Topic], camera: Topic) -> Topic | None:
    """The CameraInfo beside an image topic: image_transport's rule."""
    found = topics.get(_stem(camera.name).rpartition("/")[0] + "/camera_info")
    return found if found is not None and found.type == CAMERA_INFO and found.count else None


def _odometry(topics: Mapping[str, Topic]) -> Topic | None:
    found = [t for t in topics.values() if t.type == ODOMETRY and t.count]
    wheels = [t for t in found if not NO_WHEELS.search(t.name.lower())]
    for part in ("wheel", "odom"):
        likely = [t for t in wheels if part in t.name.lower()]
        if likely:
            return _most(likely)
    return _most(wheels)


def _most(topics: list[Topic]) -> Topic | None:
    return max(topics, key=lambda t: (t.count, -len(t.name)), default=None)
