"""Calibration: images of a board from a new camera pair -> StereoRig.

    from calibration.board import parse_board
    from calibration.calibrate import calibrate_cameras
    from calibration.imagepairs import find_pairs
    from calibration.rig import save_rig

    found = find_pairs("shots/left", "shots/right")
    result = calibrate_cameras(found.pairs, parse_board("chessboard:9x6", 0.025))
    save_rig(result.rig, "rig.yaml")

`calibration.rig` holds the rig and its file, which every other stage reads.
"""
