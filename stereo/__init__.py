"""Stereo: pair -> rectified pair -> disparity -> columns -> scan.

from stereo.pair import StereoPair
from stereo.ranger import StereoRanger

ranger = StereoRanger(load_rig("rig.yaml"))
scan = ranger(StereoPair(stamp, left, right))
"""
