"""BagReader: any bags of ROS 1 or ROS 2, read one message after the other.

Damaged messages and stretches are passed over, counted and named. Only what is being read is in
memory.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from heapq import merge
from pathlib import Path
from typing import Any, NamedTuple

from pipeline.errors import InputError
from pipeline.ros.types import reader_of
from pipeline.ros.unclosed import Raw, Unreadable, scan, version_of

# After a damaged stretch of a bag is read on from so much later [ns], twice as much each time.
FIRST_LEAP = 10_000_000
STORAGES = ("*.mcap", "*.db3", "*.bag")
BAGS = "give a .bag, a .mcap, a .db3, or the folder of a ROS 2 bag"
MEND = (
    "\"sqlite3 BAG.db3 .dump | sed 's/^ROLLBACK.*/COMMIT;/' | sqlite3 mended.db3\" may save what "
    "is in it"
)
DAMAGED = "damaged message"
STRETCH = "damaged stretch of the bag"
LOST = "messages that the bag counts and does not hold"


@dataclass(frozen=True)
class Topic:
    """name, type (as `sensor_msgs/msg/Image`), number of messages."""

    name: str
    type: str
    count: int


class Message(NamedTuple):
    """time: when it was received [ns]; content: as `rosbags` gives it."""

    topic: str
    time: int
    content: Any


class Lost(NamedTuple):
    """Messages of a topic that the index of a bag counts and that were not found."""

    topic: str
    count: int


class BagReader:
    """Bags of one drive; a context manager.

    topics: by their names. skipped: what was passed over so far, by reason. notes: what the user
    should hear of the bags.

    Raises:
        InputError: a path does not exist, or is no bag.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self.skipped: dict[str, list[str]] = {}
        self.notes: list[str] = []
        self._sources: list[_Indexed | _Unclosed] = []
        try:
            for path in paths:
                self._sources += self._open(path)
        except BaseException:
            self.close()
            raise
        self.topics: dict[str, Topic] = {}
        for topic in (t for source in self._sources for t in source.topics):
            before = self.topics.get(topic.name)
            count = topic.count + (before.count if before else 0)
            self.topics[topic.name] = Topic(topic.name, topic.type, count)

    def __enter__(self) -> BagReader:
        return self

    def __exit__(self, *_exception: object) -> None:
        self.close()

    def close(self) -> None:
        """Close all files."""
        for source in self._sources:
            source.close()

    def messages(self, topics: Collection[str]) -> Iterator[Message]:
        """The messages of these topics, those of each in the order in which they were recorded."""
        streams = [self._decoded(source, set(topics)) for source in self._sources]
        yield from merge(*streams, key=lambda message: message.time)

    def first(self, topic: str) -> Any:
        """The first message of a topic that can be read; None: there is none."""
        return next((message.content for message in self.messages([topic])), None)

    def _decoded(self, source: _Indexed | _Unclosed, topics: set[str]) -> Iterator[Message]:
        read = reader_of(source.version)
        for raw in source.raw(topics):
            if isinstance(raw, Unreadable):
                self.skip(STRETCH, f"{source.path} at {raw.place}")
                continue
            if isinstance(raw, Lost):
                self.skip(LOST, f"{raw.count} of {raw.topic}")
                continue
            try:
                message = Message(raw.topic, raw.time, read(raw.data, raw.type))
            except Exception:  # whatever damaged bytes do to a decoder
                self.skip(DAMAGED, f"{raw.topic} at {raw.time}")
                continue
            yield message

    def skip(self, reason: str, name: str) -> None:
        """Count and name what is passed over."""
        names = self.skipped.setdefault(reason, [])
        if name not in names:
            names.append(name)

    def _open(self, path: Path) -> list[_Indexed | _Unclosed]:
        if not path.exists():
            raise InputError(f"{path}: no such bag")
        try:
            return [_Indexed(path)]
        except Exception as error:  # whatever damaged bytes do to a reader
            if path.is_dir():
                return self._open_parts(path)
            unclosed = _Unclosed(path)
            if not unclosed.topics:
                remedy = MEND if path.suffix == ".db3" else BAGS
                why = str(error) or type(error).__name__
                raise InputError(f"{path}: cannot be read as a bag ({why}): {remedy}") from None
            self.notes.append(f"{path}: was never closed: what is readable in it is taken")
            return [unclosed]

    def _open_parts(self, folder: Path) -> list[_Indexed | _Unclosed]:
        """The files of a bag whose metadata.yaml is missing or does not fit."""
        files = sorted(file for ending in STORAGES for file in folder.glob(ending))
        if not files:
            raise InputError(
                f"{folder}: no bag in this folder (looked for metadata.yaml, {', '.join(STORAGES)})"
            )
        self.notes.append(f"{folder}: without a metadata.yaml that fits: its files are read")
        return [source for file in files for source in self._open(file)]


class _Indexed:
    """A bag that was closed, read by `rosbags`."""

    def __init__(self, path: Path) -> None:
        from rosbags.rosbag1 import Reader as Reader1
        from rosbags.rosbag2 import Reader as Reader2

        self.path = path
        self.version = 1 if path.suffix == ".bag" else 2
        self._reader: Any = Reader1(path) if self.version == 1 else Reader2(path)
        self._reader.open()
        counts = Counter()  # several programs may tell one topic
        for c in self._reader.connections:
            counts[c.topic, c.msgtype] += c.msgcount
        self.topics = [Topic(name, kind, count) for (name, kind), count in counts.items()]

    def close(self) -> None:
        with suppress(Exception):
            self._reader.close()

    def raw(self, topics: set[str]) -> Iterator[Raw | Unreadable | Lost]:
        """Messages by time; where the bag cannot be read it is gone on with a little later."""
        found = Counter()
        for raw in self._readable(topics):
            if isinstance(raw, Raw):
                found[raw.topic] += 1
            yield raw
        for topic in self.topics:
            if topic.name in topics and found[topic.name] < topic.count:
                yield Lost(topic.name, topic.count - found[topic.name])

    def _readable(self, topics: set[str]) -> Iterator[Raw | Unreadable]:
        connections = [c for c in self._reader.connections if c.topic in topics]
        if not connections:
            return
        start: int | None = None
        leap = FIRST_LEAP
        while start is None or start < self._reader.end_time:
            try:
                for c, time, data in self._reader.messages(connections, start=start):
                    start, leap = time + 1, FIRST_LEAP
                    yield Raw(c.topic, c.msgtype, time, data)
                return
            except Exception:  # whatever damaged bytes do to a reader
                at: int = self._reader.start_time if start is None else start
                yield Unreadable(at)
                start, leap = at + leap, 2 * leap


class _Unclosed:
    """A bag without an index, read from its beginning."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.version = version_of(path)
        counts = Counter((r.topic, r.type) for r in scan(path) if isinstance(r, Raw))
        self.topics = [Topic(name, kind, count) for (name, kind), count in counts.items()]

    def close(self) -> None:
        """No file stays open."""

    def raw(self, topics: set[str]) -> Iterator[Raw | Unreadable]:
        return (r for r in scan(self.path) if isinstance(r, Unreadable) or r.topic in topics)
