"""Any rig file in, any format out. What is read is recognised by its content, not by its name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calibration.exchange import boofcv, camera_info, euroc, kalibr, opencv_storage
from calibration.rig import RigError, StereoRig, rig_from_dict, rig_to_dict
from calibration.yamlfile import YamlFileError, dump_yaml, parse_yaml, read_text

# kind -> what people call it.
KINDS = {
    "beemap": "beemap rig.yaml",
    "ros": "ROS camera_info",
    "kalibr": "Kalibr camchain",
    "euroc": "EuRoC sensor.yaml",
    "opencv": "OpenCV FileStorage",
    "boofcv": "BoofCV stereo",
}
WRITTEN = tuple(kind for kind in KINDS if kind != "boofcv")
# How many files of one camera, or of one half of the numbers, make a rig.
FILES = {"ros": 2, "euroc": 2, "opencv": 2}
# What is looked for in a folder.
IN_FOLDERS = (
    ("mav0/cam0/sensor.yaml", "mav0/cam1/sensor.yaml"),
    ("cam0/sensor.yaml", "cam1/sensor.yaml"),
    ("left.yaml", "right.yaml"),
    ("intrinsics.yml", "extrinsics.yml"),
    ("rig.yaml",),
)


@dataclass(frozen=True)
class RigFile:
    """A rig that was read, the kind of its files, and what the reader must hear."""

    rig: StereoRig
    kind: str
    notes: list[str]


@dataclass(frozen=True)
class _Sheet:
    path: Path
    kind: str
    data: dict[str, Any]


def read_rig(
    paths: str | Path | Sequence[str | Path],
    size: tuple[int, int] | None = None,
    unit: float | None = None,
) -> RigFile:
    """Read a rig from a file, a folder, or the files of the left and the right camera.

    size: (width, height) px, for files without it. unit: metres that the translation counts, for
    formats that do not say.

    Raises:
        RigError: a file is missing, damaged or of no known format; the message names it.
    """
    given = [paths] if isinstance(paths, (str, Path)) else paths
    sheets = [_sheet(file) for path in given for file in _files(Path(path))]
    kinds = {sheet.kind for sheet in sheets}
    names = " and ".join(str(sheet.path) for sheet in sheets)
    if len(kinds) > 1:
        told = ", ".join(f"{s.path} is {KINDS[s.kind]}" for s in sheets)
        raise RigError(f"{told}: give files of one format")
    (kind,) = kinds
    if len(sheets) > FILES.get(kind, 1):
        raise RigError(f"{names}: {KINDS[kind]} takes {FILES.get(kind, 1)} file(s), not these")
    if kind in ("ros", "euroc") and len(sheets) == 1:
        raise RigError(
            f"{names}: holds one camera only: give the left and the right camera's file of a "
            f"stereo calibration ({KINDS[kind]})"
        )
    if unit is not None and kind not in ("opencv", "boofcv"):
        raise RigError(f"{names}: {KINDS[kind]} counts metres: leave --unit out")
    rig, notes = _read(kind, sheets, names, size, unit)
    if size is not None and size != rig.image_size:
        width, height = rig.image_size
        raise RigError(f"{names}: made for images of {width}x{height}: leave --size out")
    if rig.T[0] > 0 and kind != "beemap":
        notes.append(
            "its second camera stands to the left of the first: mapping needs the left camera "
            "first: calibrate with the cameras exchanged"
        )
    return RigFile(rig, kind, notes)


def write_rig(rig: StereoRig, kind: str, ending: str = "") -> tuple[dict[str, str], list[str]]:
    """Text of every file of a format by its name ("" where one file is all); and what is lost.

    kind: one of WRITTEN. ending: of the one file, which chooses YAML, XML or JSON for OpenCV;
    "": two files as stereo_calib writes them.

    Raises:
        RigError: the format cannot hold the rig's lenses.
    """
    if kind == "beemap":
        return {"": dump_yaml(rig_to_dict(rig))}, []
    notes: list[str] = []
    if kind == "kalibr":
        chain, notes = kalibr.write(rig)
        texts = {"": dump_yaml(chain)}
    elif kind == "opencv":
        texts = _opencv_texts(opencv_storage.values(rig), ending)
    else:
        sheets, notes = (camera_info if kind == "ros" else euroc).write(rig)
        texts = {name: dump_yaml(sheet) for name, sheet in sheets.items()}
    return texts, notes + _left_out(rig, kind)


def _files(path: Path) -> list[Path]:
    """The files that make a rig: `path` itself, or those in the folder `path`."""
    if not path.is_dir():
        return [path]
    for names in IN_FOLDERS:
        files = [path / name for name in names]
        if all(file.is_file() for file in files):
            return files
    looked = "; ".join(" with ".join(names) for names in IN_FOLDERS)
    raise RigError(f"{path}: no rig in this folder (looked for {looked})")


def _sheet(path: Path) -> _Sheet:
    try:
        text = read_text(path)
        storage = opencv_storage.is_storage(text)
        data = opencv_storage.parse(text, str(path)) if storage else parse_yaml(text, str(path))
    except YamlFileError as error:
        raise RigError(str(error)) from None
    kind = _kind(data) if isinstance(data, dict) else None
    if kind is None:
        raise RigError(f"{path}: not a rig file that is known here ({', '.join(KINDS.values())})")
    return _Sheet(path, kind, data)


def _kind(data: dict[str, Any]) -> str | None:
    """The format of parsed content, by the fields that only it has."""
    if "beemap_rig" in data:
        return "beemap"
    if data.get("model") == boofcv.MODEL:
        return "boofcv"
    if isinstance(data.get("cam0"), dict):
        return "kalibr"
    if "T_BS" in data:
        return "euroc"
    if "camera_matrix" in data:
        return "ros"
    known = {name for names in opencv_storage.NAMES.values() for name in names}
    return "opencv" if len(known & data.keys()) > 1 else None


def _read(
    kind: str,
    sheets: list[_Sheet],
    names: str,
    size: tuple[int, int] | None,
    unit: float | None,
) -> tuple[StereoRig, list[str]]:
    first = sheets[0].data
    if kind == "beemap":
        return rig_from_dict(first, names), []
    if kind == "kalibr":
        return kalibr.read(first, names)
    if kind == "boofcv":
        return boofcv.read(first, names, unit), []
    if kind == "opencv":
        joined = {name: value for sheet in sheets for name, value in sheet.data.items()}
        return opencv_storage.read(joined, names, size, unit)
    both = (first, sheets[1].data)
    sources = (str(sheets[0].path), str(sheets[1].path))
    if kind == "ros":
        return camera_info.read(both, sources)
    odometry = sheets[0].path.parent.parent / "odom0" / "data.csv"
    return euroc.read(both, sources, body_is_robot=odometry.is_file()), []


def _opencv_texts(values: dict[str, Any], ending: str) -> dict[str, str]:
    if ending:
        return {"": opencv_storage.write(values, ending)}
    second = ("R", "T", "R1", "R2", "P1", "P2", "Q")
    parts = {
        "intrinsics.yml": {k: v for k, v in values.items() if k not in second},
        "extrinsics.yml": {k: values[k] for k in second},
    }
    return {name: opencv_storage.write(part, ".yml") for name, part in parts.items()}


def _left_out(rig: StereoRig, kind: str) -> list[str]:
    """What no other format holds."""
    notes = []
    if rig.mount is not None and kind == "euroc":
        notes.append(
            "the mount stands in T_BS; it counts only where wheel ticks (odom0) lie beside"
        )
    elif rig.mount is not None:
        notes.append(f"{KINDS[kind]} does not hold the mount: keep the rig file")
    if rig.sections:
        notes.append(f"{KINDS[kind]} does not hold {', '.join(rig.sections)}: keep the rig file")
    if rig.rectified and kind in ("kalibr", "euroc"):
        notes.append(f"{KINDS[kind]} does not say that the images are rectified already")
    return notes
