"""What bags hold, one thing at a time: image encodings, frames, wheels, names of topics; and bags
that were cut off or damaged."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calibration.rig import Mount, StereoRig
from odometry.encoders import EncoderParameters
from pipeline.errors import InputError
from pipeline.ros.bags import BagReader, Topic
from pipeline.ros.calibration import info_fields, rig_of
from pipeline.ros.frames import Frames, quaternion_of, rotation_of
from pipeline.ros.images import DamagedImageError, ImageFiles
from pipeline.ros.topics import Named, choose
from pipeline.ros.types import COMPRESSED, IMAGE
from pipeline.ros.wheels import WheelJoints, find_wheels, ticks_of
from stereo.encoded import decode_image
from tests.rig_files import assert_same_rig, rigs
from tests.ros_bags import Message, Types, transform, write_bag

COUNT = 300  # messages of the small bag


def image(encoding: str, data: np.ndarray, width: int, height: int, pad: int = 3) -> Any:
    """An Image message whose rows are padded; data: (height, bytes of a row)."""
    rows = np.pad(data, ((0, 0), (0, pad)), constant_values=77)
    return SimpleNamespace(
        encoding=encoding,
        width=width,
        height=height,
        step=rows.shape[1],
        is_bigendian=0,
        data=rows.ravel(),
    )


def decoded(message: Any) -> np.ndarray:
    ending, data = ImageFiles().file("/left", IMAGE, message)
    assert ending == "png"
    found = decode_image(data)
    assert isinstance(found, np.ndarray)
    return found


def colours() -> np.ndarray:
    """Even patches of colour (24, 32, 3) BGR: every encoding can tell them."""
    rng = np.random.default_rng(1)
    return np.kron(rng.integers(30, 220, (3, 4, 3)), np.ones((8, 8, 1))).astype(np.uint8)


def mosaic(bgr: np.ndarray, pattern: str) -> np.ndarray:
    """What a sensor behind a filter `rggb` (first row, second row) sees."""
    channel = {"b": 0, "g": 1, "r": 2}
    raw = np.zeros(bgr.shape[:2], np.uint8)
    for n, letter in enumerate(pattern):
        raw[n // 2 :: 2, n % 2 :: 2] = bgr[n // 2 :: 2, n % 2 :: 2, channel[letter]]
    return raw


@pytest.mark.parametrize("encoding", ["mono8", "8UC1"])
def test_grey_pixels_stay(encoding):
    grey = np.random.default_rng(2).integers(0, 255, (24, 32), np.uint8)
    assert (decoded(image(encoding, grey, 32, 24)) == grey).all()


@pytest.mark.parametrize(
    ("encoding", "order"),
    [("bgr8", [0, 1, 2]), ("rgb8", [2, 1, 0]), ("bgra8", [0, 1, 2, 0]), ("rgba8", [2, 1, 0, 0])],
)
def test_colours_stay(encoding, order):
    told = colours()[..., order].reshape(24, -1)
    assert (decoded(image(encoding, told, 32, 24)) == colours()).all()


@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
def test_bayer_patterns_give_the_colours_back(pattern):
    raw = mosaic(colours(), pattern)
    found = decoded(image(f"bayer_{pattern}8", raw, 32, 24))
    inner = np.zeros((24, 32), bool)
    for row in range(0, 24, 8):
        for column in range(0, 32, 8):  # away from the edges of the patches
            inner[row + 3 : row + 5, column + 3 : column + 5] = True
    np.testing.assert_array_equal(found[inner], colours()[inner])


@pytest.mark.parametrize(
    ("encoding", "luma"), [("yuv422", 1), ("uyvy", 1), ("yuv422_yuy2", 0), ("yuyv", 0)]
)
def test_yuv_images_give_the_colours_back(encoding, luma):
    # BT.601 as video has it: Y from 16 to 235, both differences about 128.
    b, g, r = np.moveaxis(colours().astype(float), 2, 0)
    y = 16.0 + 0.257 * r + 0.504 * g + 0.098 * b
    u = 128.0 - 0.148 * r - 0.291 * g + 0.439 * b
    v = 128.0 + 0.439 * r - 0.368 * g - 0.071 * b
    told = np.zeros((24, 32, 2))
    told[..., luma] = y
    told[:, ::2, 1 - luma], told[:, 1::2, 1 - luma] = u[:, ::2], v[:, ::2]
    told = np.rint(told).astype(np.uint8)
    found = decoded(image(encoding, told.reshape(24, -1), 32, 24))
    assert np.abs(found.astype(int) - colours()).max() <= 3


def test_deep_images_are_scaled_alike():
    """12 bits in 16: the first image says how deep both cameras are."""
    deep = np.linspace(0, 4095, 32 * 24).astype(np.uint16).reshape(24, 32)
    files = ImageFiles()
    for encoding, values in (("mono16", deep), ("16UC1", deep // 4)):
        _, data = files.file("/left", IMAGE, image(encoding, values.view(np.uint8), 32, 24))
        found = decode_image(data)
        assert isinstance(found, np.ndarray)
        assert np.abs(found - values * (255.0 / 4095.0)).max() <= 0.51
    assert files.bits == 12


def test_compressed_images_stay_what_they_are_and_damaged_ones_are_refused():
    files = ImageFiles()
    for ending in ("jpg", "png"):
        data = cv2.imencode(f".{ending}", colours())[1].tobytes()
        message = SimpleNamespace(data=np.frombuffer(data, np.uint8))
        assert files.file("/left", COMPRESSED, message) == (ending, data)
        message.data = message.data[:-20]
        with pytest.raises(DamagedImageError):
            files.file("/left", COMPRESSED, message)
    tiff = cv2.imencode(".bmp", colours())[1]
    ending, data = files.file("/left", COMPRESSED, SimpleNamespace(data=tiff))
    assert ending == "png"
    np.testing.assert_array_equal(decode_image(data), colours())
    with pytest.raises(DamagedImageError):
        files.file("/left", IMAGE, image("bgr8", np.zeros((24, 32), np.uint8), 32, 24))
    with pytest.raises(
        InputError, match=r"/left: encoding '32FC1' is not known here \(known: mono"
    ):
        files.file("/left", IMAGE, image("32FC1", np.zeros((24, 128), np.uint8), 32, 24))


def topics(*names: str, kind: str = COMPRESSED, **counts: int) -> dict[str, Topic]:
    return {name: Topic(name, kind, counts.get("count", 10)) for name in names}


@pytest.mark.parametrize(
    ("names", "left"),
    [
        (["/right/image_raw", "/left/image_raw", "/depth/left/image"], "/left/image_raw"),
        (["/cam1/image_raw", "/cam0/image_raw", "/cam2/image_raw"], "/cam0/image_raw"),
        (["/camera/infra1/image_rect_raw", "/camera/infra2/image_rect_raw"], "/camera/infra1/ima"),
        (["/s/left/image_rect", "/s/right/image_rect", "/s/left/image_raw", "/s/right/image_raw"],
         "/s/left/image_raw"),
        (["/zed/left_raw/image_raw_color", "/zed/right_raw/image_raw_color"], "/zed/left_raw/ima"),
    ],
)  # fmt: skip
def test_cameras_are_guessed_by_their_names(names, left):
    found = choose(topics(*names), Named(), "bag")
    assert found.left.name.startswith(left)
    assert found.right.name != found.left.name
    assert found.rectified == ("rect" in left or "infra" in left)


def test_odometry_of_the_wheels_is_preferred():
    cameras = topics("/left/image", "/right/image")
    kind = "nav_msgs/msg/Odometry"
    others = topics("/odometry/filtered", "/odom", "/wheel/odom", "/visual/odom", kind=kind)
    found = choose(cameras | others, Named(), "bag").odometry
    assert found is not None
    assert found.name == "/wheel/odom"


@given(st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1))
def test_quaternions_and_rotations_agree(q):
    unit = np.array(q) / np.linalg.norm(q)
    R = rotation_of(unit)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(rotation_of(quaternion_of(R)), R, atol=1e-12)


def test_the_mount_is_told_from_the_frame_on_the_floor():
    types, frames = Types(2), Frames()
    half = math.sqrt(0.5)
    links = [
        transform(types, "/base_footprint", "base_link", (0.0, 0.0, 0.1), (0.0, 0.0, half, half)),
        transform(types, "base_link", "/eye", (0.2, 0.0, 0.3), (-0.5, 0.5, -0.5, 0.5)),
        transform(types, "eye", "base_footprint", (9.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)),
    ]
    frames.take(types("tf2_msgs/TFMessage", transforms=links))
    found = frames.mount("eye", None)
    assert found is not None
    mount, base = found
    assert base == "base_footprint"
    true = Mount(height=0.4, yaw=math.pi / 2, x=0.0, y=0.2)
    np.testing.assert_allclose(mount.rotation, true.rotation, atol=1e-12)
    np.testing.assert_allclose(mount.position, true.position, atol=1e-12)
    linked = frames.mount("/eye", "base_link")
    assert linked is not None
    assert linked[0].height == pytest.approx(0.3)
    assert frames.mount("eye", "arm") is None
    assert frames.mount("elsewhere", None) is None


def capital(fields: dict[str, Any]) -> Any:
    """As ROS 1 names them."""
    return SimpleNamespace(**{k.upper() if len(k) == 1 else k: v for k, v in fields.items()})


@settings(max_examples=10)
@given(rigs())
def test_rigs_survive_camera_info(rig: StereoRig):
    """Every lens model, through messages of ROS 1 and of ROS 2."""
    left, right = info_fields(rig)
    lower = (SimpleNamespace(**left), SimpleNamespace(**right))
    for messages in (lower, (capital(left), capital(right))):
        again, notes = rig_of(messages, ("/left/camera_info", "/right/camera_info"), False)
        assert notes == []
        assert_same_rig(again, rig, 1e-7)
    rectified, _ = rig_of(lower, ("l", "r"), rectified=True)
    assert rectified.rectified
    assert rectified.left.distortion_model == "none"
    assert rectified.left.fx == left["p"][0]
    assert rectified.baseline == pytest.approx(rig.baseline, rel=1e-6)


def test_an_uncalibrated_camera_is_named():
    zeros = SimpleNamespace(
        width=640, height=480, distortion_model="", d=[], k=[0.0] * 9, r=[0.0] * 9, p=[0.0] * 12
    )
    with pytest.raises(InputError, match=r"/l/info: camera_matrix: .*give --rig rig.yaml"):
        rig_of((zeros, zeros), ("/l/info", "/r/info"), False)


@given(st.lists(st.tuples(st.integers(-99999, 99999), st.integers(-99999, 99999)), max_size=9))
def test_wheel_angles_are_the_ticks_they_were(counts):
    parameters = EncoderParameters(1234, 0.05, 0.05, 0.3, 16, reversed=(False, True))
    joints = WheelJoints("l", "r")
    for left, right in counts:
        angles = [2.0 * math.pi * n / 1234 for n in (left, -right)]
        message = SimpleNamespace(name=["x", "l", "r"], position=[0.0, *angles])
        found = ticks_of(message, joints, parameters)
        assert found is not None
        assert (found[0] - left) % 2**16 == (found[1] - right) % 2**16 == 0
        assert -(2**15) <= min(found) <= max(found) < 2**15
    assert ticks_of(SimpleNamespace(name=["l"], position=[1.0]), joints, parameters) is None


@pytest.mark.parametrize(
    ("names", "found"),
    [
        (["arm_left", "arm_right", "wheel_left_joint", "wheel_right_joint"], "wheel_left_joint"),
        (["rear_left_wheel", "rear_right_wheel", "front_left_wheel"], "rear_left_wheel"),
        (["left_joint", "right_joint"], "left_joint"),
        (["shoulder", "elbow"], None),
    ],
)
def test_wheels_are_guessed_by_their_names(names, found):
    wheels = find_wheels([SimpleNamespace(name=names)], "/joint_states", None)
    assert (wheels and wheels.left) == found


def small(types: Types) -> Iterator[Message]:
    """Odometry at rest, padded so that the bag has several chunks."""
    for n in range(COUNT):
        head = types.header(n * 10_000_000 + 1, "f" * 12_000)
        state = types(
            "sensor_msgs/JointState",
            header=head,
            name=["left", "right"],
            position=np.array([float(n), 0.0]),
            velocity=np.zeros(0),
            effort=np.zeros(0),
        )
        yield "/joint_states", "sensor_msgs/msg/JointState", n * 10_000_000 + 1, state


@pytest.fixture(scope="module")
def small_bags(tmp_path_factory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("small")
    bags = {name: write_bag(folder / name, name, small) for name in ("ros1", "mcap", "sqlite3")}
    return {
        ".bag": bags["ros1"],
        ".mcap": bags["mcap"] / "mcap.mcap",
        ".db3": bags["sqlite3"] / "sqlite3.db3",
    }


def read(path: Path) -> tuple[list[float], BagReader]:
    """The first angle in every message."""
    with BagReader([path]) as bag:
        return [m.content.position[0] for m in bag.messages(list(bag.topics))], bag


@pytest.mark.parametrize("ending", [".bag", ".mcap"])
@pytest.mark.parametrize("share", [0.4, 0.9, 0.9999])
def test_of_a_bag_that_was_cut_off_the_beginning_is_read(small_bags, tmp_path, ending, share):
    whole = small_bags[ending].read_bytes()
    cut = tmp_path / f"cut{ending}"
    cut.write_bytes(whole[: int(share * len(whole))])
    found, bag = read(cut)
    assert found == list(range(len(found)))
    assert 0.9 * share * COUNT - 100 < len(found) <= COUNT
    assert bag.notes == [f"{cut}: was never closed: what is readable in it is taken"]
    assert bag.topics["/joint_states"].count == len(found)


def test_a_database_that_was_cut_off_says_how_to_mend_it(small_bags, tmp_path):
    whole = small_bags[".db3"].read_bytes()
    (tmp_path / "cut.db3").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"cut.db3: cannot be read .*sqlite3 BAG.db3 .dump"):
        read(tmp_path / "cut.db3")


def test_a_folder_without_metadata_is_read_by_its_files(small_bags, tmp_path):
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "a.mcap").write_bytes(small_bags[".mcap"].read_bytes())
    found, bag = read(tmp_path / "bag")
    assert found == list(range(COUNT))
    assert "without a metadata.yaml" in bag.notes[0]


@pytest.mark.parametrize("ending", [".bag", ".mcap", ".db3"])
@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damaged_bytes_cost_messages_and_nothing_else(small_bags, tmp_path, ending, data):
    content = bytearray(small_bags[ending].read_bytes())
    cut = data.draw(st.integers(0, len(content)) | st.just(len(content)))
    for at in data.draw(st.lists(st.integers(0, len(content) - 1), max_size=40)):
        content[at] ^= data.draw(st.integers(1, 255))
    (tmp_path / f"bad{ending}").write_bytes(content[:cut])
    try:
        found, bag = read(tmp_path / f"bad{ending}")
    except InputError:  # so damaged that it is no bag
        return
    lost = COUNT - len(Counter(found))
    assert lost == 0 or bag.skipped or bag.notes
