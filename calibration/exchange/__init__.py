"""Rig files of other programs, in and out.

    from calibration.exchange.formats import read_rig, write_rig

    found = read_rig("camchain.yaml")       # recognised by its content
    found.rig, found.kind, found.notes      # what the format could not say stands in the notes
    files, notes = write_rig(found.rig, "ros")

One file a format: `camera_info` (ROS), `kalibr`, `euroc`, `opencv_storage` and, to read only,
`boofcv`. Each reads parsed content into a `StereoRig` and writes one into file contents.
"""
