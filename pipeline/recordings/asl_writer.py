"""AslWriter: appends stereo pairs, wheel ticks and truth to a recording in the EuRoC/ASL layout.

Every line is flushed as it is written, so that a power cut costs the last pair at most.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, TextIO

import cv2
import numpy as np

from calibration.exchange.euroc import camera_sheets
from calibration.rig import RigError, StereoRig, rig_to_dict
from calibration.yamlfile import dump_yaml
from pipeline.errors import InputError
from pipeline.recordings.recorded_rig import RIG_FILE, marked

IMAGE_HEADER = "#timestamp [ns],filename"
TICKS_HEADER = "#timestamp [ns],left [ticks],right [ticks]"
ODOMETRY_HEADER = "#timestamp [ns],x [m],y [m],theta [rad]"
TRUTH_HEADER = (
    "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],"
    "q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z [],"
    "v_RS_R_x [m s^-1],v_RS_R_y [m s^-1],v_RS_R_z [m s^-1],"
    "b_w_RS_S_x [rad s^-1],b_w_RS_S_y [rad s^-1],b_w_RS_S_z [rad s^-1],"
    "b_a_RS_S_x [m s^-2],b_a_RS_S_y [m s^-2],b_a_RS_S_z [m s^-2]"
)


@dataclass(frozen=True)
class ImageFormat:
    """File ending of the images and, for jpg, their quality (0 to 100)."""

    ending: str = "jpg"
    quality: int = 90

    def encode(self, image: np.ndarray) -> bytes:
        """The image file's bytes."""
        options = [cv2.IMWRITE_JPEG_QUALITY, self.quality] if self.ending == "jpg" else []
        good, data = cv2.imencode(f".{self.ending}", image, options)
        if not good:
            raise InputError(f"image of shape {image.shape}: cannot be encoded as {self.ending}")
        return data.tobytes()


class AslWriter:
    """Writes `folder`/mav0 as pairs, ticks and truth come in; a context manager.

    folder: exists. rate: pairs a second, noted in sensor.yaml; None: not known. encoders: the keys
    of `odom0/sensor.yaml` (ticks_per_revolution, left_radius, ...), None where there are no wheels.
    keep_rig: the rig file itself is laid beside `mav0`, too, so that any lens can be told.

    Raises:
        RigError: the rig cannot be told in this layout (distortion model) and is not kept.
    """

    def __init__(
        self,
        folder: Path,
        rig: StereoRig,
        rate: float | None,
        encoders: Mapping[str, Any] | None = None,
        image_format: ImageFormat = ImageFormat(),
        keep_rig: bool = False,
    ) -> None:
        self.root = Path(folder) / "mav0"
        self.image_format = image_format
        self._files: dict[str, TextIO] = {}
        self._stack = ExitStack()
        sheets = {}
        try:
            sheets = camera_sheets(rig, rate)
        except RigError:
            if not keep_rig:
                raise
        for name in ("cam0", "cam1"):
            (self.root / name / "data").mkdir(parents=True)
            self._open(name, IMAGE_HEADER)
        for name, sheet in sheets.items():
            self._sensor(name, sheet)
        if keep_rig:
            text = marked(dump_yaml(rig_to_dict(rig)))
            (Path(folder) / RIG_FILE).write_text(text, encoding="utf-8")
        if encoders is not None:
            self._sensor("odom0", {"sensor_type": "encoders", **encoders})
            self._open("odom0", TICKS_HEADER)

    def __enter__(self) -> AslWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stack.close()

    def add_pair(self, stamp: int, left: np.ndarray, right: np.ndarray) -> None:
        """Append a raw pair (uint8) taken at `stamp` ns."""
        for camera, image in (("cam0", left), ("cam1", right)):
            data = self.image_format.encode(image)
            self.add_image(camera, stamp, self.image_format.ending, data)

    def add_image(self, camera: str, stamp: int, ending: str, data: bytes) -> None:
        """Append the file of one image of `cam0` or `cam1`, taken at `stamp` ns, as it is."""
        name = f"{stamp}.{ending}"
        (self.root / camera / "data" / name).write_bytes(data)
        self._line(camera, f"{stamp},{name}")

    def add_ticks(self, stamp: int, left: int, right: int) -> None:
        """Append the encoders' counters as read at `stamp` ns."""
        self._line("odom0", f"{stamp},{left},{right}")

    def add_odometry(self, stamp: int, pose: np.ndarray) -> None:
        """Append where odometry has the robot (x m, y m, theta rad), in full precision."""
        if "odometry0" not in self._files:
            self._open("odometry0", ODOMETRY_HEADER)
        x, y, theta = (float(v) for v in pose)
        self._line("odometry0", f"{stamp},{x!r},{y!r},{theta!r}")

    def add_truth(self, stamp: int, pose: np.ndarray, velocity: np.ndarray) -> None:
        """Append the robot's true pose (x m, y m, theta rad) and velocity (2,) m/s."""
        if "state_groundtruth_estimate0" not in self._files:
            self._open("state_groundtruth_estimate0", TRUTH_HEADER)
        x, y, theta = (float(v) for v in pose)
        qw, qz = np.cos(theta / 2.0), np.sin(theta / 2.0)
        vx, vy = (float(v) for v in velocity)
        self._line(
            "state_groundtruth_estimate0",
            f"{stamp},{x:.6f},{y:.6f},0,{qw:.9f},0,0,{qz:.9f},{vx:.6f},{vy:.6f},0,0,0,0,0,0,0",
        )

    def add_depth(self, stamp: int, depth: np.ndarray) -> None:
        """Append the true depth (H, W) m of the raw left image: 16-bit millimetres, 0 = none."""
        if "depth0" not in self._files:
            self._open("depth0", IMAGE_HEADER)
            (self.root / "depth0" / "data").mkdir()
        millimetres = np.rint(np.where(np.isfinite(depth), depth, 0.0) * 1000.0)
        millimetres[millimetres > 65535.0] = 0.0
        image = ImageFormat("png").encode(millimetres.astype(np.uint16))
        (self.root / "depth0" / "data" / f"{stamp}.png").write_bytes(image)
        self._line("depth0", f"{stamp},{stamp}.png")

    def _sensor(self, name: str, sheet: Mapping[str, Any]) -> None:
        (self.root / name).mkdir(parents=True, exist_ok=True)
        text = dump_yaml(dict(sheet))
        (self.root / name / "sensor.yaml").write_text(text, encoding="utf-8")

    def _open(self, name: str, header: str) -> None:
        (self.root / name).mkdir(parents=True, exist_ok=True)
        file = open(self.root / name / "data.csv", "w", encoding="ascii", newline="\n")  # noqa: SIM115
        self._files[name] = self._stack.enter_context(file)
        self._line(name, header)

    def _line(self, name: str, text: str) -> None:
        self._files[name].write(text + "\n")
        self._files[name].flush()
