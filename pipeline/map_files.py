"""Occupancy maps as files: `map.npz`, and ROS map_server's image and YAML."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from calibration.yamlfile import dump_yaml
from mapping.grid import FREE, OCCUPIED, OccupancyGrid
from pipeline.errors import InputError
from pipeline.textfiles import read_fields

# map_server's grey values, and the thresholds by which it reads them; which cell gets which is said
# by `OccupancyGrid.classes`. 0.196 and not the usual 0.25: grey 205 is an occupancy of 0.19608,
# which a larger threshold would turn from unknown into free.
OCCUPIED_GREY, UNKNOWN_GREY, FREE_GREY = 0, 205, 254
OCCUPIED_THRESHOLD = 0.65
FREE_THRESHOLD = 0.196


def read_map(path: str | Path) -> OccupancyGrid:
    """Read `MAP.npz`, a map_server `MAP.yaml`, or the `map.npz` of a result folder.

    Raises:
        InputError: naming the file, the field and the remedy.
    """
    path = Path(path)
    if path.is_dir():
        path = path / "map.npz"
    if not path.is_file():
        raise InputError(
            f"{path}: no such file: give a result folder, a map.npz or a map_server YAML"
        )
    if path.suffix == ".npz":
        return _read_npz(path)
    if path.suffix in (".yaml", ".yml"):
        return _read_map_server(path)
    raise InputError(f"{path}: unknown kind of map '{path.suffix}': give .npz, .yaml or a folder")


def write_npz(path: str | Path, grid: OccupancyGrid) -> None:
    """Write `map.npz`: probability float32 (H, W), origin (2,), cell; same map, same bytes."""
    np.savez_compressed(
        path,
        probability=grid.probability.astype(np.float32),
        origin=np.asarray(grid.origin, float),
        cell=np.float64(grid.cell),
    )


def write_map_server(folder: str | Path, grid: OccupancyGrid, stem: str = "map") -> None:
    """Write `<stem>.pgm` and `<stem>.yaml` for ROS map_server (mode trinary)."""
    folder = Path(folder)
    classes = grid.classes
    grey = np.full_like(classes, UNKNOWN_GREY, dtype=np.uint8)
    grey[classes == OCCUPIED] = OCCUPIED_GREY
    grey[classes == FREE] = FREE_GREY
    header = f"P5\n{grey.shape[1]} {grey.shape[0]}\n255\n".encode("ascii")
    # The image's first row is the map's last: images count downwards.
    (folder / f"{stem}.pgm").write_bytes(header + grey[::-1].tobytes())
    fields = {
        "image": f"{stem}.pgm",
        "mode": "trinary",
        "resolution": float(grid.cell),
        "origin": [float(grid.origin[0]), float(grid.origin[1]), 0.0],
        "negate": 0,
        "occupied_thresh": OCCUPIED_THRESHOLD,
        "free_thresh": FREE_THRESHOLD,
    }
    (folder / f"{stem}.yaml").write_text(dump_yaml(fields), encoding="utf-8")


def _read_npz(path: Path) -> OccupancyGrid:
    names = ("probability", "origin", "cell")
    try:
        with np.load(path, allow_pickle=False) as data:
            missing = [name for name in names if name not in data.files]
            fields = {name: np.asarray(data[name], float) for name in names if name not in missing}
    except Exception as error:
        # A damaged archive raises whatever zipfile, zlib or numpy stumble over.
        raise InputError(f"{path}: not a readable map ({error}): write it again") from None
    if missing:
        raise InputError(
            f"{path}: no array '{missing[0]}': a map holds probability, origin and cell"
        )
    probability, origin, cell = (fields[name] for name in names)
    if probability.ndim != 2 or not probability.size:
        raise InputError(
            f"{path}: probability has shape {probability.shape}; a map needs (rows, columns)"
        )
    if origin.shape != (2,) or not np.isfinite(origin).all():
        raise InputError(f"{path}: origin is {origin.tolist()}; give x, y in metres")
    if cell.size != 1 or not cell.item() > 0.0:
        raise InputError(f"{path}: cell is {cell.tolist()}; give the cell's side in metres")
    x, y = origin.tolist()
    return OccupancyGrid(probability.astype(np.float32), (x, y), cell.item())


def _read_map_server(path: Path) -> OccupancyGrid:
    data = read_fields(path)
    if data.get("mode", "trinary") != "trinary":
        raise InputError(f"{path}: mode is {data['mode']!r}; only 'trinary' maps can be read")
    cell = _number(data, "resolution", path)
    if cell <= 0.0:
        raise InputError(f"{path}: resolution is {cell}; give the cell's side in metres")
    occupied = _number(data, "occupied_thresh", path)
    free = _number(data, "free_thresh", path)
    grey = _read_grey(path, data.get("image"))
    occupancy = grey / 255.0 if data.get("negate", 0) else (255.0 - grey) / 255.0
    probability = np.full(grey.shape, np.nan, np.float32)
    probability[occupancy > occupied] = 1.0
    probability[occupancy < free] = 0.0
    return OccupancyGrid(probability[::-1].copy(), _origin(data, path), cell)


def _read_grey(yaml_path: Path, name: Any) -> np.ndarray:
    """The image (H, W) of a map_server file, float; row 0 = top."""
    import cv2

    if not isinstance(name, str):
        raise InputError(f"{yaml_path}: image: {name!r}; give the name of the map's image")
    path = yaml_path.parent / name
    try:
        content = np.frombuffer(path.read_bytes(), np.uint8)
    except OSError as error:
        raise InputError(
            f"{yaml_path}: image: {path} cannot be read ({error.strerror or error})"
        ) from None
    grey = cv2.imdecode(content, cv2.IMREAD_GRAYSCALE) if content.size else None
    if grey is None:
        raise InputError(f"{yaml_path}: image: {path} is not a readable image (PGM or PNG)")
    return grey.astype(float)


def _origin(data: dict, path: Path) -> tuple[float, float]:
    origin = data.get("origin")
    try:
        x, y, yaw = (float(v) for v in origin)  # type: ignore[union-attr]
    except (TypeError, ValueError):
        raise InputError(f"{path}: origin: {origin!r}; give [x, y, yaw]") from None
    if yaw != 0.0:
        raise InputError(f"{path}: origin: the yaw {yaw} must be 0: turn the image instead")
    return x, y


def _number(data: dict, key: str, path: Path) -> float:
    value = data.get(key)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not np.isfinite(value):
        raise InputError(f"{path}: {key}: {value!r} is not a number; map_server needs one")
    return float(value)
