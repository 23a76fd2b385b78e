"""OpenCV's FileStorage (YAML, XML, JSON), with the names of its samples.

One file, or intrinsics.yml (M1 D1 M2 D2) and extrinsics.yml (R T R1 R2 P1 P2 Q) as the sample
stereo_calib writes them. The format knows no units and, in that sample, no image size.
Its YAML (`%YAML:1.0`) is not quite YAML, and cv2 is not robust against damaged files: the text
is parsed here. cv2 writes it.
"""

from __future__ import annotations

import re
from typing import Any
from xml.etree import ElementTree

import numpy as np

from calibration.exchange.fields import (
    block,
    checked,
    image_size,
    matrix,
    numbers,
    pinhole,
    rotation,
    some_numbers,
)
from calibration.exchange.lenses import from_opencv
from calibration.exchange.rectification import rectification
from calibration.rig import CameraModel, RigError, StereoRig
from calibration.yamlfile import YamlFileError, parse_yaml

# The names in use for each of them, ours first.
NAMES = {
    "M1": ("M1", "K1", "cameraMatrix1"),
    "M2": ("M2", "K2", "cameraMatrix2"),
    "D1": ("D1", "distCoeffs1"),
    "D2": ("D2", "distCoeffs2"),
    "R": ("R",),
    "T": ("T",),
}
SIZES = ("image_size", "imageSize", "size")
# Baselines in metres; a number outside is more likely counted in squares or millimetres.
USUAL_BASELINES = (0.01, 1.0)


def is_storage(text: str) -> bool:
    """Whether a text is a FileStorage in YAML or XML; one in JSON is plain YAML, too.

    OpenCV 4 begins with `%YAML:1.0`, OpenCV 5 with `%YAML 1.0`.
    """
    return text.lstrip("\ufeff \n\r\t").startswith(("%YAML", "<"))


def parse(text: str, source: str) -> dict[str, Any]:
    """The named values of a FileStorage; a matrix is a dict of rows, cols, dt and data.

    Raises:
        RigError: it is damaged.
    """
    text = text.lstrip("\ufeff \n\r\t")
    try:
        if text.startswith("<"):
            data = {node.tag: _from_xml(node) for node in ElementTree.fromstring(text)}
        else:
            # The first line stays, as a comment: line numbers in errors are right.
            data = parse_yaml("#" + re.sub(r"!!opencv-[\w-]+", "", text), source)
    except YamlFileError as error:
        raise RigError(str(error)) from None
    except (ElementTree.ParseError, ValueError, RecursionError) as error:
        raise RigError(f"{source}: not a whole FileStorage of OpenCV ({error})") from None
    if not isinstance(data, dict):
        raise RigError(f"{source}: no named values in this FileStorage of OpenCV")
    return data


def read(
    data: dict[str, Any], source: str, size: tuple[int, int] | None, unit: float | None
) -> tuple[StereoRig, list[str]]:
    """The rig in the values of one file, or of several joined; and what had to be assumed.

    size: (width, height), needed where the file holds none. unit: what T counts [m]; None: metres.

    Raises:
        RigError: a value is missing or wrong, or the baseline is none in metres.
    """
    notes: list[str] = []
    found = {name: _found(data, name, source) for name in NAMES}
    left = _camera(data, found["M1"], found["D1"], source, notes)
    right = _camera(data, found["M2"], found["D2"], source, notes)
    R = rotation(matrix(data, "R", (3, 3), source), f"{source}: R")
    T = in_metres(matrix(data, "T", (3, 1), source).ravel(), unit, source)
    size = _size(data, source) or size
    if size is None:
        raise RigError(f"{source}: holds no image_width, image_height: give --size, as in 640x480")
    rectified = data.get("rectified") in (1, True)
    return checked(StereoRig(size, left, right, R, T, rectified=rectified), source), notes


def in_metres(T: np.ndarray, unit: float | None, source: str) -> np.ndarray:
    """T (3,) counted in `unit` [m] as metres; without a unit it must look like metres.

    Raises:
        RigError: it does not.
    """
    if unit is not None:
        return T * unit
    length = float(np.linalg.norm(T))
    if not USUAL_BASELINES[0] <= length <= USUAL_BASELINES[1]:
        raise RigError(
            f"{source}: T has length {length:.4g}, which is no usual baseline in metres: say what "
            "it counts: --unit 25mm (squares of 25 mm), --unit 1mm, or --unit 1m if it is metres"
        )
    return T


def values(rig: StereoRig) -> dict[str, Any]:
    """What is written: names of the samples, and the image size beside them."""
    made = rectification(rig)
    return {
        "image_width": int(rig.image_size[0]),
        "image_height": int(rig.image_size[1]),
        "distortion_model": rig.left.distortion_model,
        "M1": rig.left.K,
        "D1": rig.left.D[None],
        "M2": rig.right.K,
        "D2": rig.right.D[None],
        "R": np.asarray(rig.R, float),
        "T": np.reshape(rig.T, (3, 1)).astype(float),
        "R1": made.R1,
        "R2": made.R2,
        "P1": made.P1,
        "P2": made.P2,
        "Q": made.Q,
        "rectified": int(rig.rectified),
    }


def write(values: dict[str, Any], ending: str) -> str:
    """The text of a FileStorage; `ending`, one of .yml, .yaml, .xml, .json, chooses its kind."""
    import cv2

    storage = cv2.FileStorage(ending, cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    for name, value in values.items():
        storage.write(name, value)
    return storage.releaseAndGetString()


def _found(data: dict[str, Any], name: str, source: str) -> str:
    for known in NAMES[name]:
        if data.get(known) is not None:
            return known
    raise RigError(
        f"{source}: {' or '.join(NAMES[name])} is missing: a rig needs M1 D1 M2 D2 R T (the "
        "sample stereo_calib writes them into intrinsics.yml and extrinsics.yml: give both)"
    )


def _camera(
    data: dict[str, Any], K_name: str, D_name: str, source: str, notes: list[str]
) -> CameraModel:
    fx, fy, cx, cy = pinhole(matrix(data, K_name, (3, 3), source), f"{source}: {K_name}")
    where = f"{source}: {D_name}.data"
    D = some_numbers(block(data, D_name, source), where)
    told = data.get("distortion_model")
    if told == "fisheye":
        return CameraModel(fx, fy, cx, cy, "fisheye", tuple(numbers(D, 4, where)))
    if told is None and len(D) == 4:
        notes.append(
            f"{source}: {D_name}: four numbers are taken as k1 k2 p1 p2; those of a fisheye lens "
            "need a line 'distortion_model: fisheye' in the file"
        )
    return CameraModel(fx, fy, cx, cy, *from_opencv(D, where))


def _size(data: dict[str, Any], source: str) -> tuple[int, int] | None:
    for name in SIZES:
        if data.get(name) is not None:
            return image_size(data[name], f"{source}: {name}")
    if data.get("image_width") is None and data.get("image_height") is None:
        return None
    pair = [data.get("image_width"), data.get("image_height")]
    return image_size(pair, f"{source}: image_width, image_height")


def _from_xml(node: ElementTree.Element) -> Any:
    """A matrix, a number, a list of numbers or a text."""
    if len(node):
        children: dict[str, Any] = {child.tag: _from_xml(child) for child in node}
        if "data" in children and not isinstance(children["data"], list):
            children["data"] = [children["data"]]
        return children
    words = [_word(word) for word in (node.text or "").split()]
    return words[0] if len(words) == 1 else words


def _word(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text.strip('"')
