"""Sensor: from the light that reaches both cameras to the bytes they deliver.

Cheap beside the rendering of the light, so that one rendered pair can be exposed with many seeds.

    light -> lens (vignetting, defocus) -> exposure -> noise -> gain -> tone curve -> JPEG
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from calibration.rig import CameraModel, StereoRig
from simulation.camera_rays import pixel_rays
from simulation.faults import PLAIN, CameraFaults
from simulation.tracer import to_grey

NOISE_PURPOSE = 1  # keys of the random generators: (seed, purpose, camera, frame)
# A small sensor. With the tone curve's root its noise is near 1.7 grey levels from dark to bright.
FULL_WELL = 5700.0  # electrons at white
READ_NOISE = 4.0  # electrons


@dataclass(frozen=True)
class LightPair:
    """left, right: (H, W) float32, the light on both raw images; 1 saturates a plain camera."""

    left: np.ndarray
    right: np.ndarray


class Sensor:
    """Both cameras' lenses and sensors with their `faults`; the shutter's are the renderer's.

    May be called from several threads at once.
    """

    def __init__(self, rig: StereoRig, faults: CameraFaults = PLAIN) -> None:
        self.faults = faults
        self._exposure = (faults.exposure_left, faults.exposure_right)
        self._gain = (faults.gain_left, faults.gain_right)
        self._fall_off: tuple[np.ndarray, ...] | None = None
        if faults.vignetting:
            self._fall_off = tuple(
                fall_off(camera, rig.image_size) ** faults.vignetting
                for camera in (rig.left, rig.right)
            )

    def expose(self, light: LightPair, seed: int, frame: int) -> tuple[np.ndarray, np.ndarray]:
        """The images (H, W) uint8, left and right; `seed` and `frame` key the noise."""
        left, right = (
            self._image(image, camera, seed, frame)
            for camera, image in enumerate((light.left, light.right))
        )
        return left, right

    def noise_free(self, light: np.ndarray, camera: int) -> np.ndarray:
        """Grey levels (H, W) float32 of camera 0 (left) or 1, before noise, rounding and JPEG."""
        return to_grey(self._gathered(light, camera) * self._gain[camera])

    def noise_sigma(self, gathered: np.ndarray) -> np.ndarray:
        """Standard deviation of the noise of the `gathered` light, before the gain.

        Photons arrive as they like (their variance is their number); the read-out adds its own.
        """
        variance = np.maximum(gathered, 0.0) / FULL_WELL + (READ_NOISE / FULL_WELL) ** 2
        return self.faults.noise * np.sqrt(variance)

    def _gathered(self, light: np.ndarray, camera: int) -> np.ndarray:
        """Light in the sensor's wells: behind the lens, times the exposure."""
        gathered = np.asarray(light, np.float32) * np.float32(self._exposure[camera])
        if self._fall_off is not None:
            gathered *= self._fall_off[camera]
        if self.faults.defocus:
            gathered = cv2.GaussianBlur(gathered, (0, 0), self.faults.defocus)
        return gathered

    def _image(self, light: np.ndarray, camera: int, seed: int, frame: int) -> np.ndarray:
        read = self._gathered(light, camera)
        if self.faults.noise:
            chance = np.random.default_rng((seed, NOISE_PURPOSE, camera, frame))
            noise = chance.standard_normal(read.shape, np.float32)
            read = np.maximum(read + self.noise_sigma(read) * noise, 0.0)
        grey = np.rint(to_grey(read * self._gain[camera])).astype(np.uint8)
        return _through_jpeg(grey, self.faults.jpeg) if self.faults.jpeg else grey


def fall_off(camera: CameraModel, image_size: tuple[int, int]) -> np.ndarray:
    """(H, W) float32: cos^4 of the angle between each pixel's ray and the optical axis, the light
    a plain lens lets through there (natural vignetting)."""
    rays = pixel_rays(camera, image_size, 1).reshape(image_size[1], image_size[0], 3)
    return (1.0 + rays[..., 0] ** 2 + rays[..., 1] ** 2) ** -2


def _through_jpeg(image: np.ndarray, quality: int) -> np.ndarray:
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE))
