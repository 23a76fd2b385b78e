"""One recording of a batch: used again when all that decides it is the same, gone on with."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import msgspec
import pytest

from calibration.rig import save_rig
from pipeline import run as run_module
from pipeline.batch import map_task
from pipeline.batch.map_task import MapTask, StoppedError, key_of, map_into, prepared
from pipeline.map_request import MapRequest
from pipeline.recordings import open_recording
from tests.batch_runs import QUICK, results

OVERRIDES = (QUICK[1],)


@pytest.fixture
def kitchen(recordings, tmp_path) -> Path:
    """A recording that may be changed."""
    return Path(shutil.copytree(recordings / "kitchen", tmp_path / "rec" / "kitchen"))


@pytest.fixture
def task(kitchen, tmp_path) -> MapTask:
    claim = tmp_path / "claim"
    claim.touch()
    return MapTask(MapRequest(str(kitchen)), tmp_path / "out", claim, None, OVERRIDES)


@pytest.fixture(scope="module")
def reference(recordings, tmp_path_factory) -> Path:
    """The result of an unbroken run; not to be changed."""
    folder = tmp_path_factory.mktemp("reference")
    request = MapRequest(str(recordings / "kitchen"))
    assert map_into(MapTask(request, folder / "out", folder, None, OVERRIDES)) is True
    return folder / "out"


def key(task: MapTask, threads: int = 1) -> str:
    job, _, asked = prepared(task, threads)
    return key_of(asked, job)


def test_the_key_follows_what_decides_the_result_and_not_where_it_lies(task, kitchen, tmp_path):
    first = key(task)
    assert len(first) == 16
    assert key(task, threads=2) == first

    def asking(**changes: object) -> str:
        request = msgspec.structs.replace(task.request, **changes)
        return key(msgspec.structs.replace(task, request=request))

    moved = Path(shutil.copytree(kitchen, tmp_path / "elsewhere"))
    assert asking(input=str(moved)) == first
    settings = tmp_path / "settings.yaml"
    settings.write_text("mapping: {particles: 5}\n")
    assert key(msgspec.structs.replace(task, settings=settings, overrides=())) == first
    rig, poses = tmp_path / "rig.yaml", tmp_path / "poses.tum"
    recorded = open_recording(kitchen).rig
    assert recorded is not None
    save_rig(recorded, rig)
    poses.write_text("0 0 0 0 0 0 0 1\n1 1 0 0 0 0 0 1\n")
    with_rig, with_poses = asking(rig=str(rig)), asking(motion=f"poses:{poses}")
    poses.write_text("0 0 0 0 0 0 0 1\n1 2 0 0 0 0 0 1\n")
    others = [
        asking(seed=2),
        asking(motion="visual"),
        with_rig,
        with_poses,
        asking(motion=f"poses:{poses}"),
        key(msgspec.structs.replace(task, overrides=("mapping.particles=6",))),
    ]
    assert len({first, *others}) == 1 + len(others)


def test_the_key_follows_the_bytes_of_the_recording(task, kitchen, tmp_path, monkeypatch):
    first = key(task)
    (kitchen / ".DS_Store").write_text("of no weight")
    (kitchen / "run").mkdir()
    (kitchen / "run" / "run.json").write_text("{}")  # a result that was put there
    assert key(task) == first
    image = sorted((kitchen / "mav0" / "cam1" / "data").iterdir())[3]
    whole = image.read_bytes()
    image.write_bytes(whole[:-1] + b"x")
    changed = key(task)
    image.write_bytes(whole)
    assert key(task) == first
    image.rename(image.with_name("other.png"))
    renamed = key(task)
    image.with_name("other.png").rename(image)
    truth = kitchen / "mav0" / "state_groundtruth_estimate0" / "data.csv"
    truth.unlink()
    assert len({first, changed, renamed, key(task)}) == 4
    before = key(task)
    monkeypatch.setattr(map_task, "source_digest", lambda patterns: "of another beemap")
    assert key(task) != before


def test_what_stands_there_is_used_again_only_when_it_is_the_same(task, reference):
    shutil.copytree(reference, task.output)
    assert map_into(task) is False
    run = task.output / "run.json"
    run.write_text(run.read_text().replace('"partial": false', '"partial": true'))
    assert map_into(task) is True
    assert results(task.output) == results(reference)
    assert map_into(msgspec.structs.replace(task, overrides=("mapping.particles=4",))) is True
    assert results(task.output) != results(reference)


def test_a_task_whose_call_is_gone_stops_and_the_next_goes_on(task, reference, monkeypatch):
    watch, looked = map_task.Watch, []

    class Impatient(watch):
        """Gone after some pairs."""

        def gone(self) -> bool:
            looked.append(1)
            return len(looked) > 6

    monkeypatch.setattr(map_task, "Watch", Impatient)
    with pytest.raises(StoppedError, match="another call works in this folder now"):
        map_into(task)
    assert not task.output.exists()
    checkpoint = task.output.with_name("out.checkpoint")
    asked = json.loads(checkpoint.read_bytes().partition(b"\n")[0])
    assert asked["key"] == key(task)

    seen: list[str] = []
    observe = run_module.observe
    monkeypatch.setattr(
        run_module, "observe", lambda pair, *rest: (seen.append(pair.name), observe(pair, *rest))[1]
    )
    monkeypatch.setattr(map_task, "Watch", watch)
    assert map_into(task) is True
    assert 0 < len(seen) < 10  # of 13 pairs
    assert results(task.output) == results(reference)
    assert not checkpoint.exists()


def test_a_checkpoint_of_another_task_is_begun_anew(task):
    checkpoint = task.output.with_name("out.checkpoint")
    asked = {"beemap_checkpoint": 1, "input": "other", "key": "0"}
    checkpoint.write_text(json.dumps(asked) + "\n")
    assert map_into(task) is True
    assert not checkpoint.exists()
