"""Do the images of a recording and the rig belong together?"""

from __future__ import annotations

import numpy as np

from calibration.rig import StereoRig
from pipeline.errors import InputError
from pipeline.frontend import IMAGE_ERRORS
from pipeline.recordings.base import Recording, image_size
from stereo.pair_check import check_pair
from stereo.ranger import StereoRanger

# Pairs looked at for exchanged images before a run.
SWAP_SAMPLES = 3


def check_images(recording: Recording, rig: StereoRig, ranger: StereoRanger) -> None:
    """Refuse images that the rig does not fit, or that are exchanged, before any work."""
    size = image_size(recording.pairs)
    if size is None:
        raise InputError(f"{recording.path}: none of {len(recording.pairs)} images can be read")
    if size != rig.image_size:
        raise InputError(
            f"{recording.path}: image is {size[0]}x{size[1]}, the rig is calibrated for "
            f"{rig.image_size[0]}x{rig.image_size[1]}: give the rig of these cameras with --rig"
        )
    indices = np.linspace(0, len(recording.pairs) - 1, SWAP_SAMPLES).astype(int)
    looks = []
    for index in sorted(set(indices.tolist())):
        try:
            pair = recording.pairs[index].load()
            # Pairs that are no stereo at all tell nothing; they are counted in their turn, too.
            if not check_pair(pair.left, pair.right).defect:
                looks.append(ranger.looks_swapped(pair))
        except IMAGE_ERRORS:
            continue  # damaged pairs are counted when their turn comes
    if looks and sum(looks) * 2 > len(looks):
        raise InputError(
            f"{recording.path}: left and right images are exchanged (the disparities are "
            "negative): swap the two folders, or the cameras in the rig"
        )
