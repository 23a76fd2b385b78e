"""Stage 1 of the data's way: pair -> rectified pair -> disparity -> columns -> scan.

    ranger = StereoRanger(load_rig("rig.yaml"))
    scan = ranger(StereoPair(stamp, left, right))

Names are loaded when first used, so that `import stereo` stays light.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from stereo.errors import StereoError as StereoError
    from stereo.pair import StereoPair as StereoPair
    from stereo.ranger import StereoFrame as StereoFrame
    from stereo.ranger import StereoRanger as StereoRanger
    from stereo.scan import RangeScan as RangeScan
    from stereo.settings import StereoSettings as StereoSettings

_HOME = {
    "RangeScan": "stereo.scan",
    "StereoError": "stereo.errors",
    "StereoFrame": "stereo.ranger",
    "StereoPair": "stereo.pair",
    "StereoRanger": "stereo.ranger",
    "StereoSettings": "stereo.settings",
}


def __getattr__(name: str):
    if name not in _HOME:
        raise AttributeError(f"module 'stereo' has no attribute '{name}'")
    return getattr(import_module(_HOME[name]), name)
