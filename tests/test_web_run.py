"""A run on a page: what it shows is what the run knows, and the run is none the worse."""

from __future__ import annotations

import json
import math
import shutil
import threading
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

pytest.importorskip("uvicorn", reason="the extra 'web' is not installed")

from calibration.rig import CameraModel, minibee
from mapping.grid import OCCUPIED, UNKNOWN, OccupancyGrid
from mapping.settings import MappingSettings
from odometry.motion import compose
from pipeline import extras
from pipeline.commands import web_options
from pipeline.errors import InputError
from pipeline.map_files import read_map
from pipeline.recordings.base import PairFiles
from pipeline.run import make_ranger
from pipeline.settings import load_settings
from pipeline.trajectory import read_tum
from pipeline.web import encoding, hub, run_pictures, server
from pipeline.web.run_page import LONGEST_NAME, RunPage
from stereo.camera import CapturedPair, Frame
from stereo.scan import RangeScan
from tests.scan_logs import drive
from tests.web_viewers import Onlooker, news, viewer

FEW = ("--set", "mapping.particles=20")
SAME = ("map.npz", "map.pgm", "trajectory.tum", "online.tum", "health.csv", "settings.yaml")


class Client(threading.Thread):
    """A viewer beside a command: marks, saves, and stops it when its run is over."""

    def __init__(self, monkeypatch) -> None:
        super().__init__()
        self.url: list[str] = []
        self.started = threading.Event()
        self.answers: list[dict] = []
        self.onlooker: Onlooker | None = None
        monkeypatch.setattr(hub, "RATE", 15.0)
        enter = server.WebServer.__enter__

        def entered(web: server.WebServer) -> server.WebServer:
            running = enter(web)
            self.url.append(running.url)
            self.started.set()
            return running

        monkeypatch.setattr(server.WebServer, "__enter__", entered)
        self.start()

    def run(self) -> None:
        assert self.started.wait(30.0)
        self.onlooker = Onlooker(self.url[0])
        with viewer(self.url[0]) as socket:
            while news(socket, "pose", 30.0).values["pose"][0] < 0.5:
                pass
            for order in ('"mark","value":"the  door"', '"mark","value":""', '"save"', '"fly"'):
                socket.send(f'{{"do":{order}}}')
                self.answers.append(news(socket, "answer").values)
            while news(socket, "run", 30.0).values["phase"] != "ended":
                pass
            for order in ('"save"', '"mark","value":"late"', '"stop"'):
                socket.send(f'{{"do":{order}}}')
                self.answers.append(news(socket, "answer").values)


def test_a_replay_shows_the_run_and_ends_as_the_run(office_piece, tmp_path, beemap, monkeypatch):
    mapped = beemap("map", office_piece, "-o", tmp_path / "run", *FEW, "--seed", 3, "--quiet")
    assert mapped.code == 0, mapped.err
    client = Client(monkeypatch)
    again = ("replay", tmp_path / "run", "-o", tmp_path / "again", "--speed", 30)
    replayed = beemap(*again, "--web", "--port", 0)
    client.join()
    assert replayed.code == 0, replayed.err
    for name in SAME:
        one, other = ((tmp_path / run / name).read_bytes() for run in ("run", "again"))
        assert one == other, name

    done = [(answer["to"], answer["done"]) for answer in client.answers]
    assert done[:4] == [("mark", True), ("mark", False), ("save", True), ("fly", False)]
    assert done[4:] == [("save", False), ("mark", False), ("stop", True)]
    (place,) = json.loads((tmp_path / "again" / "places.json").read_text())["places"]
    path = read_tum(tmp_path / "again" / "trajectory.tum")
    at = path.poses[path.stamps == place["stamp"]][0]
    assert place["name"] == "the door"
    assert (place["x"], place["y"]) == pytest.approx(at[:2], abs=1e-3)
    pictures = [(tmp_path / run / "map.png").read_bytes() for run in ("run", "again")]
    assert pictures[0] != pictures[1]  # the place is drawn

    assert client.onlooker is not None
    client.onlooker.join()
    topics = client.onlooker.topics
    last = topics["run"][-1].values
    assert last["phase"] == "ended"
    assert any("map saved" in text for _, text in last["notes"])
    assert dict(last["figures"])["local maps"]
    grid = read_map(tmp_path / "again")
    shown = topics["map"][-1].values
    assert (shown["height"], shown["width"]) == grid.probability.shape
    assert shown["origin"] == pytest.approx(grid.origin)
    assert [p["name"] for p in shown["places"]] == ["the door"]
    codes = np.frombuffer(zlib.decompress(topics["map"][-1].blob), np.uint8)
    assert np.array_equal(codes.view(np.int8), grid.classes.ravel())
    assert topics["pose"][-1].values["pose"] == pytest.approx(path.poses[-1], abs=1e-3)
    ends = np.frombuffer(topics["path"][-1].blob, np.float32).reshape(-1, 2)[[0, -1]]
    assert ends == pytest.approx(path.poses[[0, -1], :2], abs=1e-3)
    counts = [message.values["count"] for message in topics["local"]]
    assert 1 <= min(counts) < max(counts) <= 10


def test_a_scan_log_is_replayed_without_pictures(tmp_path, beemap, monkeypatch):
    log, driven = tmp_path / "room.log", drive()
    log.write_text("".join(driven.flaser(i) + "\n" for i in range(len(driven.stamps))))
    client = Client(monkeypatch)
    outcome = beemap("replay", log, "--web", "--port", 0, "--speed", 50, *FEW)
    client.join()
    assert outcome.code == 0, outcome.err
    assert client.onlooker is not None
    client.onlooker.join()
    topics = client.onlooker.topics
    assert "picture" not in topics
    assert topics["run"][-1].values["cameras"] is False
    assert topics["map"][-1].values["maps"] > 0


def test_mistakes_are_one_line(office_piece, tmp_path, refused, monkeypatch):
    assert "give --web" in refused("replay", office_piece)
    rig = tmp_path / "rig.yaml"
    assert "--host: belongs to --web" in refused("live", rig, "-o", tmp_path, "--host", "::")
    run = tmp_path / "run"
    run.mkdir()
    (run / "run.json").write_text("{}")
    assert "map.npz" in refused("replay", run, "--web")
    for name in ("map.npz", "trajectory.tum", "settings.yaml"):
        (run / name).write_text("{}")
    assert "made again as it was" in refused("replay", run, "--web", "--seed", 3)
    # A live run's recording lies in its folder, which must not be replaced.
    shutil.copytree(office_piece, run / "recording")
    request = {"input": "moved", "seed": 1}
    (run / "run.json").write_text(json.dumps({"request": request}))
    again = ("replay", run, "--web", "-o", run, "--force")
    assert "holds the recording" in refused(*again)
    with server.WebServer(RunPage("x", None, threading.Event()), None, 0, print) as busy:
        line = refused("replay", office_piece, "--web", "--port", busy.port)
        assert f"--port {busy.port}: is taken: " in line
        assert "is free" in line
    monkeypatch.setitem(extras.MODULES, "web", ("starlette", "not_installed_here"))
    assert "pip install 'beemap[web]'" in refused("replay", office_piece, "--web")
    assert "pip install 'beemap[web]'" in refused("live", rig, "-o", tmp_path / "o", "--web")


def test_names_of_places_are_checked():
    page = RunPage("run", None, threading.Event())
    for name in ("", "  ", "x" * (LONGEST_NAME + 1), "a\x00b", "door"):
        with pytest.raises(hub.RefusedError):
            page.command("mark", name)
    with pytest.raises(hub.RefusedError, match="-o OUT"):
        page.command("save", "")


def test_a_run_that_fails_says_so_on_its_page(tmp_path, capfd):
    onlookers = []

    def fail() -> None:
        with web_options.watched(True, None, 0, "run", tmp_path, threading.Event()):
            address = capfd.readouterr().err.removeprefix("page: ").strip()
            onlookers.append(Onlooker(address))
            while not onlookers[0].topics["run"]:
                pass
            raise InputError("the left camera: no such device")

    with pytest.raises(InputError):
        fail()
    onlookers[0].join()
    last = onlookers[0].topics["run"][-1].values
    assert (last["phase"], last["failure"]) == ("failed", "the left camera: no such device")


@pytest.fixture(scope="module")
def ranger():
    return make_ranger(minibee(), load_settings(None, ()))


def test_columns_are_tinted_where_they_look(ranger):
    rig, camera = minibee(), ranger.camera
    edges = run_pictures.strips(rig, camera)
    # An image that needs no rectifying: even columns, from edge to edge.
    assert edges[:, 0] == pytest.approx(np.linspace(0, 1, run_pictures.COLUMNS + 1), abs=1e-6)
    assert edges[:, 2] == pytest.approx(edges[:, 0], abs=1e-6)
    assert (edges[:, 1] < edges[:, 3]).all()
    bent = CameraModel(492.8, 492.8, 319.5, 239.5, "radtan", (-0.3, 0.1, 0.0, 0.0))
    barrel = run_pictures.strips(type(rig)(rig.image_size, bent, bent, rig.R, rig.T), camera)
    assert barrel[0, 0] > edges[0, 0] + 0.01  # a barrel draws the edges in


def test_what_stands_still_is_tinted_where_it_is_after_the_robot_moved(ranger):
    camera = ranger.camera
    bearing = np.arctan2(camera.cx - np.arange(camera.width), camera.f)[::-1]
    origin = (0.1, 0.06, 0.0)
    ranges = np.full(bearing.size, np.nan)
    post = np.abs(bearing) < 0.02  # straight ahead, 2 m away
    ranges[post] = 2.0
    scan = RangeScan(0, origin, bearing, ranges, np.full(bearing.size, 0.01), 4.0)
    here = np.array([1.0, 2.0, 0.5])
    still = run_pictures.tint(scan, camera, here, here)
    (there,) = np.nonzero(still)
    assert abs(there.mean() - run_pictures.COLUMNS / 2) < 2
    assert still[there] == pytest.approx(1 + 253 / 2, abs=1)
    # Nearer, and turned to the left: the post is larger, and to the right.
    moved = run_pictures.tint(scan, camera, here, compose(here, np.array([1.0, 0.0, 0.2])))
    (there,) = np.nonzero(moved)
    expected = camera.cx + camera.f * math.tan(0.2)
    assert there.mean() * camera.width / run_pictures.COLUMNS == pytest.approx(expected, abs=20)
    assert moved[there].max() < still.max() * 0.6
    ranges[:] = np.inf
    free = run_pictures.tint(scan, camera, here, here)
    assert (free == run_pictures.FREE).all()


def test_a_large_map_is_sent_coarser_and_loses_no_obstacle():
    p = np.full((40, 4000), 0.1, np.float32)
    p[:, 3000:] = np.nan
    p[7, 1234] = 0.95
    codes, cell = run_pictures.cells(OccupancyGrid(p, (0.0, 0.0), 0.05))
    assert cell == pytest.approx(0.15)
    assert max(codes.shape) <= run_pictures.MOST_CELLS
    assert codes[7 // 3, 1234 // 3] == OCCUPIED
    assert (codes[:, 1001:].view(np.int8) == UNKNOWN).all()


def test_a_long_path_is_sent_thinned():
    path = np.stack([np.linspace(0, 900, 200_000), np.zeros(200_000), np.zeros(200_000)], axis=1)
    thin = run_pictures.thinned(path)
    assert len(thin) <= run_pictures.PATH_POINTS + 2
    assert thin[0, 0] == 0.0
    assert thin[-1, 0] == 900.0
    assert run_pictures.thinned(np.empty((0, 3))).shape == (0, 2)
    assert len(run_pictures.thinned(np.zeros((50, 3)))) <= 2


def test_images_go_out_as_they_came_or_small(tmp_path):
    noise = np.random.default_rng(1).integers(0, 255, (960, 1280), np.uint8)
    jpeg = cv2.imencode(".jpg", noise[:240, :320])[1].tobytes()
    frame = Frame(1, jpeg)
    assert run_pictures.left_image(CapturedPair(frame, frame)) == (jpeg, False)
    assert run_pictures.left_image(CapturedPair(frame, None)) == (jpeg, True)
    torn = Frame(1, jpeg[:-500])
    assert run_pictures.left_image(CapturedPair(torn, frame)) is None
    large = Frame(1, cv2.imencode(".jpg", noise)[1].tobytes())
    for data in (large, Frame(1, noise)):
        sent = run_pictures.left_image(CapturedPair(data, data))
        assert sent is not None
        small = cv2.imdecode(np.frombuffer(sent[0], np.uint8), cv2.IMREAD_UNCHANGED)
        assert small is not None
        assert small.shape[1] == encoding.WIDE
    file = tmp_path / "left.png"
    cv2.imwrite(str(file), noise[:24, :32])
    sent = run_pictures.left_image(PairFiles(1, file, file))
    assert sent is not None
    assert sent[0][:2] == b"\xff\xd8"
    gone = Path("gone.jpg")
    assert run_pictures.left_image(PairFiles(1, gone, gone)) is None


def test_the_local_map_so_far_is_seen_from_the_robot():
    bearing = np.linspace(-0.5, 0.5, 101)
    scan = RangeScan(0, (0.0, 0.0, 0.0), bearing, 2.0 / np.cos(bearing), np.full(101, 0.02), 4.0)
    near = RangeScan(1, (0.0, 0.0, 0.0), bearing, 1.5 / np.cos(bearing), np.full(101, 0.02), 4.0)
    before = np.array([3.0, 1.0, math.pi / 2])
    window = [(before, scan), (compose(before, np.array([0.5, 0.0, 0.0])), near)]
    grid = run_pictures.local_map(window, MappingSettings())
    row = int((0.0 - grid.origin[1]) / grid.cell)
    wall = np.nanargmax(grid.probability[row]) * grid.cell + grid.origin[0]
    assert wall == pytest.approx(1.5, abs=0.1)
