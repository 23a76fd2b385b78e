"""BagWriter: messages into a new bag: one .mcap, one ROS 1 .bag, or a ROS 2 folder (sqlite3)."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

from pipeline.errors import InputError
from pipeline.folders import Kind, check_target, has, new_folder
from pipeline.new_files import check_free, new_files
from pipeline.ros.types import CAMERA_INFO, typestore

ENDINGS = (".mcap", ".bag")
# The metadata that every distribution since Humble reads.
METADATA = 8
MARK_REACH = 1 << 16  # bytes from the end of an MCAP file in which its metadata are


class BagWriter:
    """A context manager; the bag stands at `target` when the block ends.

    target: does not exist, its folder does; its ending chooses the container.
    """

    def __init__(self, target: Path) -> None:
        self._target = target
        self._folder = target.with_name(f"{target.name}.making")
        self.version = 1 if target.suffix == ".bag" else 2
        self._types = typestore(self.version)
        self._writer = self._make()
        self._topics: dict[str, Any] = {}

    def __enter__(self) -> BagWriter:
        self._writer.open()
        return self

    def __exit__(self, kind: type[BaseException] | None, *exception: object) -> None:
        self._writer.__exit__(kind, *exception)
        if kind is None and self.version == 2:
            self._settle()

    def make(self, kind: str, **fields: Any) -> Any:
        """A message of that type, as `sensor_msgs/msg/Image`; fields by ROS 2's names."""
        if self.version == 1 and kind == "std_msgs/msg/Header":
            fields["seq"] = 0
        elif self.version == 1 and kind == CAMERA_INFO:  # its matrices are capital letters there
            fields = {name.upper() if len(name) == 1 else name: v for name, v in fields.items()}
        return self._types.types[kind](**fields)

    def write(self, topic: str, kind: str, stamp: int, message: Any, latched: bool = False) -> None:
        """Append a message received at `stamp` ns.

        latched: who comes later must still get it (ROS 2: transient local).
        """
        if topic not in self._topics:
            self._topics[topic] = self._announce(topic, kind, latched)
        store = self._types
        pack = store.serialize_ros1 if self.version == 1 else store.serialize_cdr
        self._writer.write(self._topics[topic], stamp, pack(message, kind))

    def _make(self) -> Any:
        if self.version == 1:
            from rosbags.rosbag1 import Writer

            return Writer(self._target)
        from rosbags.rosbag2 import StoragePlugin, Writer

        mcap = self._target.suffix == ".mcap"
        plugin = StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3
        writer = Writer(self._folder / self._target.stem, version=METADATA, storage_plugin=plugin)
        writer.set_custom_data("beemap", version("beemap"))
        return writer

    def _announce(self, topic: str, kind: str, latched: bool) -> Any:
        if self.version == 1:
            return self._writer.add_connection(
                topic, kind, typestore=self._types, latching=int(latched)
            )
        return self._writer.add_connection(
            topic, kind, typestore=self._types, offered_qos_profiles=[_quality(latched)]
        )

    def _settle(self) -> None:
        """`rosbags` writes a folder: a single .mcap is taken out of it."""
        made = self._folder / self._target.stem
        if self._target.suffix == ".mcap":
            os.replace(made / f"{made.name}.mcap", self._target)
            (made / "metadata.yaml").unlink()
            made.rmdir()
        else:
            os.replace(made, self._target)
        self._folder.rmdir()


def check_bag(target: Path, force: bool) -> None:
    """Refuse a target early, before any work is spent on it.

    Raises:
        InputError: an ending that names no container; it is there and `force` is off.
    """
    if not target.suffix:
        check_target(target, force, _kind(target))
    elif target.suffix in ENDINGS:
        check_free([target], force)
        if target.suffix == ".mcap" and target.exists() and not _marked(target):
            raise InputError(
                f"{target}: is not a bag that beemap wrote: recordings are never replaced: choose "
                "another name"
            )
    else:
        raise InputError(
            f"{target}: give a name that ends in .mcap or in .bag, or one without an ending for "
            "the folder of a ROS 2 bag (sqlite3)"
        )


def _marked(file: Path) -> bool:
    """Whether an MCAP file carries our mark, which stands near its end."""
    with file.open("rb") as opened:
        opened.seek(max(0, file.stat().st_size - MARK_REACH))
        return b"beemap" in opened.read()


def _kind(target: Path) -> Kind:
    """The folder of a ROS 2 bag that beemap wrote; a recorded one is not replaced."""
    name = target.resolve().name
    return Kind(
        "a bag that beemap wrote", ("metadata.yaml", f"{name}.db3"), has("metadata.yaml", "beemap")
    )


@contextmanager
def new_bag(target: Path, force: bool) -> Iterator[BagWriter]:
    """A writer; the bag appears whole at `target`, or not at all.

    Raises:
        InputError: as `check_bag`; or it cannot be written.
    """
    check_bag(target, force)
    if target.suffix:
        with new_files([target], force) as partial, BagWriter(partial / target.name) as writer:
            yield writer
        return
    with new_folder(target, force, _kind(target)) as partial:
        inner = partial / target.resolve().name
        with BagWriter(inner) as writer:
            yield writer
        for file in inner.iterdir():
            os.replace(file, partial / file.name)
        inner.rmdir()


def _quality(latched: bool) -> Any:
    """ROS 2's quality of service: reliable; latched: the last message is kept for who comes."""
    from rosbags.interfaces import (
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )

    never = QosTime(0, 0)  # not asked for, which is for ever
    return Qos(
        QosHistory.KEEP_LAST,
        1 if latched else 10,
        QosReliability.RELIABLE,
        QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
        never,
        never,
        QosLiveliness.AUTOMATIC,
        never,
        False,
    )
