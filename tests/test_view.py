"""`beemap view`: all of a run on one time line, in a file or on 127.0.0.1."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
import urllib.request
from collections import Counter
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import pytest

from pipeline.recordings import open_recording
from pipeline.view.entities import grid_map
from tests.conftest import PAIRS

pytest.importorskip("rerun", reason="rerun is in the extra view")

DRAWN = ("n_eff", "matched_share", "columns_answered")


def rows(file: Path) -> Counter[str]:
    """entity -> how often it was logged, read back from the file; what is told of the file itself
    is left out. Everything lies on the one time line."""
    from rerun.chunk import RrdReader

    reader = RrdReader(file)
    (kept,) = reader.recordings()
    found: Counter[str] = Counter()
    for chunk in reader.stream(store=kept):
        if chunk.entity_path.startswith("/__"):
            continue
        assert chunk.timeline_names == ([] if chunk.is_static else ["time"])
        found[chunk.entity_path] += chunk.num_rows
    return found


@pytest.fixture(scope="module")
def facts(office_run) -> dict:
    return json.loads((office_run / "run.json").read_text())


def test_a_run_made_again_is_kept_in_a_file(office_run, facts, tmp_path, beemap):
    done = beemap("view", office_run, "--save", tmp_path / "run.rrd")
    assert done.code == 0, done.err
    assert "note:" not in done.err  # nothing is missing, and the path is the same
    found = rows(tmp_path / "run.rrd")
    seen, closed = facts["counts"]["observations"], facts["local_maps"]
    expected = {
        "/world": 1,
        "/world/robot/heading": 1,
        "/world/robot": PAIRS,
        "/world/robot/scan": seen,
        "/cameras/left": seen,
        "/cameras/right": seen,
        "/cameras/disparity": seen,
        "/world/local_map": closed,
        "/world/particles": closed,
        **{f"/plots/{name}": closed for name in DRAWN},
        "/log": len(facts["health"]),
        "/world/truth": 1,
        "/world/odometry": 1,
    }
    assert {name: found.pop(name) for name in expected} == expected
    # One of each after every local map, and the smoothed ones.
    assert found == {"/world/map": closed + 1, "/world/path": closed + 1}


def test_without_its_recording_what_the_folder_holds_is_shown(
    moved_run, facts, tmp_path, refused, beemap
):
    done = beemap("view", moved_run, "--save", tmp_path / "run.rrd")
    assert done.code == 0, done.err
    assert f"its input {tmp_path / 'gone'} is not there any more" in done.err
    found = rows(tmp_path / "run.rrd")
    assert found["/world/robot"] == PAIRS
    assert found["/plots/n_eff"] == facts["local_maps"]
    assert found["/world/map"] == found["/world/path"] == found["/world/truth"] == 1
    assert not any("cameras" in entity or "particles" in entity for entity in found)
    line = refused("view", moved_run, "--save", tmp_path / "run.rrd")
    assert "already exists: give --force" in line
    line = refused("view", moved_run, "--save", tmp_path / "b.rrd", "--recording", tmp_path / "no")
    assert "no: no such folder" in line
    assert not (tmp_path / "b.rrd").exists()


def test_damage_to_the_recording_is_shown_and_told(moved_run, facts, office, tmp_path, beemap):
    """A pair that cannot be read stands in the log; without every other reading of the wheels the
    path is another."""
    open_recording(office).pairs[5].files[0].write_bytes(b"")
    table = office / "mav0" / "odom0" / "data.csv"
    lines = table.read_text().splitlines()
    table.write_text("\n".join([lines[0], *lines[1::2]]) + "\n")
    done = beemap("view", moved_run, "--save", tmp_path / "a.rrd", "--recording", office)
    assert done.code == 0
    assert re.search(r"note: made again, the path is up to \d\.\d{3} m from the one", done.err)
    assert rows(tmp_path / "a.rrd")["/log"] == len(facts["health"]) + 1


def test_a_run_of_a_scan_log_is_shown_without_images(log_run, tmp_path, beemap):
    assert beemap("view", log_run, "--save", tmp_path / "b.rrd", "--quiet").code == 0
    found = rows(tmp_path / "b.rrd")
    assert found["/world/robot"] == 40
    assert found["/world/particles"] > 1
    assert "/cameras/left" not in found


def test_large_maps_are_shown_coarser_with_their_walls(office_run):
    import numpy as np

    from mapping.grid import OccupancyGrid

    p = np.full((900, 500), np.nan, np.float32)
    p[10:800, 20:480] = 0.1
    p[333, 20:480] = 0.9  # a wall of one cell
    shown = grid_map(OccupancyGrid(p, (-3.0, 2.0), 0.05), whole=False)
    assert shown.format is not None
    assert shown.data is not None
    (form,), (cells,) = (shown.format.as_arrow_array().to_pylist(), shown.data.as_arrow_array())
    assert (form["width"], form["height"]) == (167, 300)
    data = np.array(cells.as_py(), np.uint8).reshape(300, 167, 4)
    wall = data[300 - 1 - 111]
    assert (wall[8:158, 0] < 80).all()
    assert (wall[:6, 3] == 0).all()
    assert (data[150, 8:158, 0] > 200).all()


def listening(process: int) -> set[str]:
    """Addresses at which a process and its children listen, as Linux tells them in hexadecimal."""
    found = set()
    children = Path(f"/proc/{process}/task/{process}/children").read_text().split()
    for one in (str(process), *children):
        sockets = {
            fd.readlink().name for fd in Path(f"/proc/{one}/fd").iterdir() if fd.is_symlink()
        }
        for table in ("tcp", "tcp6"):
            for line in Path(f"/proc/{one}/net/{table}").read_text().splitlines()[1:]:
                fields = line.split()
                if fields[3] == "0A" and f"socket:[{fields[9]}]" in sockets:
                    found.add(fields[1].partition(":")[0])
    return found


@pytest.mark.skipif(sys.platform != "linux", reason="asks Linux who listens where")
def test_the_viewer_listens_on_this_machine_alone_and_speaks_to_it_alone(office_run):
    command = [sys.executable, "-m", "pipeline.cli", "view", office_run, "--no-browser", "--quiet"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        address, said = process.stdout.readline().split("  ")
        assert said == "(Ctrl-C ends it)\n"
        assert listening(process.pid) == {"0100007F"}  # 127.0.0.1
        with urllib.request.urlopen(address, timeout=10.0) as page:
            assert b"Rerun" in page.read()
            policy = page.headers["Content-Security-Policy"]
        assert "connect-src 'self' blob: data: http://127.0.0.1:*" in policy
        (sink,) = parse_qs(urlsplit(address).query)["url"]
        assert sink.startswith("rerun+http://127.0.0.1:")
    finally:
        process.send_signal(signal.SIGINT)
        assert process.wait(30.0) == 0


def test_what_cannot_be_shown(office_run, tmp_path, refused, monkeypatch):
    assert "no result folder" in refused("view", tmp_path, "--save", tmp_path / "a.rrd")
    monkeypatch.setitem(sys.modules, "rerun", None)
    line = refused("view", office_run, "--save", tmp_path / "a.rrd")
    assert "pip install 'beemap[view]'" in line
    assert not list(tmp_path.iterdir())
