"""Videos and tables of ticks as recordings."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.recordings import open_input, open_recording
from pipeline.recordings.base import Recording
from pipeline.recordings.tick_table import read_tick_table
from pipeline.recordings.video import KEPT

SIZE = (64, 48)


def write_video(path: Path, frames: list[np.ndarray], rate: float = 10.0) -> None:
    size = frames[0].shape[1], frames[0].shape[0]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), rate, size)
    for frame in frames:
        writer.write(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR))
    writer.release()


def shades(count: int, add: int, width: int = SIZE[0]) -> list[np.ndarray]:
    return [np.full((SIZE[1], width), 4 * n + add, np.uint8) for n in range(count)]


def test_two_videos_are_a_recording(tmp_path):
    write_video(tmp_path / "left.avi", shades(30, 0))
    write_video(tmp_path / "right.avi", shades(32, 100))
    recording = open_recording(tmp_path)
    assert recording.kind == "left and right video"
    assert [pair.stamp for pair in recording.pairs[:3]] == [0, 100_000_000, 200_000_000]
    assert len(recording.pairs) == 30
    assert len(recording.skipped["frame beyond the end of the other video"]) == 2
    # In order, out of order as threads ask, and far back.
    for number in [0, 1, 3, 2, 29, 29 - KEPT + 1, 5]:
        pair = recording.pairs[number].load()
        assert pair.left.mean() == pytest.approx(4 * number, abs=2)
        assert pair.right.mean() == pytest.approx(4 * number + 100, abs=2)


def test_a_side_by_side_video_is_a_recording_with_its_own_rate(tmp_path):
    halves = zip(shades(5, 0), shades(5, 100), strict=True)
    write_video(tmp_path / "both.avi", [np.hstack(pair) for pair in halves], 25.0)
    recording = open_input(tmp_path / "both.avi", fps=5.0)
    assert isinstance(recording, Recording)
    assert [pair.stamp for pair in recording.pairs[:2]] == [0, 200_000_000]
    pair = recording.pairs[4].load()
    assert pair.left.shape[:2] == (48, 64)
    assert (pair.left.mean(), pair.right.mean()) == pytest.approx((16, 116), abs=2)


def test_what_is_no_video_is_named(tmp_path, refused):
    (tmp_path / "both.avi").write_bytes(b"RIFF nothing")
    assert "not a video that can be read" in refused("info", tmp_path / "both.avi")


@pytest.mark.parametrize(
    ("text", "columns", "unit", "stamps"),
    [
        (
            "time,left,right\n0.5,1,2\n0.75,3,4\n",
            "time,left,right",
            None,
            [500_000_000, 750_000_000],
        ),
        ("t_ms;r;l\n5;2;1\n6;4;3\n", "t_ms,l,r", None, [5_000_000, 6_000_000]),
        ("1000 1 2\n2000 3 4\n", "1,2,3", "us", [1_000_000, 2_000_000]),
        ("stamp [ns],left,right\n7,1,2\n9,3.0,4\n", "stamp,left,right", None, [7, 9]),
        ("a\tt(us)\tL\tR\nx\t1\t1\t2\nx\t2\t3\t4\n", "t(us),L,R", None, [1000, 2000]),
    ],
)
def test_ticks_of_any_table(tmp_path, text, columns, unit, stamps):
    (tmp_path / "ticks.csv").write_text(text)
    log = read_tick_table(tmp_path / "ticks.csv", columns, unit, 0.0)
    assert log.stamps.tolist() == stamps
    assert log.left.tolist() == [1, 3]
    assert log.right.tolist() == [2, 4]
    later = read_tick_table(tmp_path / "ticks.csv", columns, unit, 1.5)
    assert (later.stamps - log.stamps).tolist() == [1_500_000_000] * 2


def test_long_stamps_keep_their_nanoseconds_and_garbage_is_counted(tmp_path):
    rows = "time,left,right\n1700000000.123456789,1,2\nx,1,2\n1700000001.5,2,y\n1700000002,3,4\n"
    (tmp_path / "ticks.csv").write_text(rows)
    log = read_tick_table(tmp_path / "ticks.csv", "time,left,right", None, 0.0)
    assert log.stamps.tolist() == [1_700_000_000_123_456_789, 1_700_000_002_000_000_000]
    assert log.skipped == {"garbled": 2}


def test_a_missing_column_is_named_with_those_that_are_there(tmp_path):
    (tmp_path / "ticks.csv").write_text("t,l,r\n1,1,1\n")
    with pytest.raises(InputError, match=r"no column 'time' \(there are: t, l, r\)"):
        read_tick_table(tmp_path / "ticks.csv", "time,left,right", None, 0.0)
    with pytest.raises(InputError, match="give three"):
        read_tick_table(tmp_path / "ticks.csv", "time,left", None, 0.0)


def test_a_recording_is_mapped_with_ticks_from_a_table(office, tmp_path, beemap):
    ticks = office / "mav0" / "odom0"
    lines = (ticks / "data.csv").read_text().splitlines()[1:]
    rows = [line.split(",") for line in lines]
    table = "\n".join(f"{int(t) / 1e9:.9f};{r};{left}" for t, left, r in rows)
    (tmp_path / "ticks.csv").write_text("seconds;r;l\n" + table + "\n")
    quick = ("--quiet", "--set", "mapping.particles=10", "--threads", "1")
    assert beemap("map", office, "-o", tmp_path / "a", *quick).code == 0
    (ticks / "data.csv").write_text("#cut\n")
    outcome = beemap(
        "map", office, "-o", tmp_path / "b", *quick,
        "--ticks", tmp_path / "ticks.csv", "--ticks-columns", "seconds,l,r",
    )  # fmt: skip
    assert outcome.code == 0, outcome.err
    assert (tmp_path / "a" / "map.npz").read_bytes() == (tmp_path / "b" / "map.npz").read_bytes()
