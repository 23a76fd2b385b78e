"""What odometry does wrong, how far it parts from the matched path, and the remedies."""

from __future__ import annotations

import math
from dataclasses import replace

from mapping.odometry_witness import OdometryErrors
from pipeline.health.finding import Finding, Grade
from pipeline.health.parting import STRETCH, Parting

CALIBRATE = "beemap odometry calibrate {recording}{rig_option} -o {new_rig} --force"
# Beyond these the matched path cannot be trusted to have put all of it right: in distance,
# rotation (shares) and drift (rad/m), and in the parting over a stretch. With wheels 3 % too large
# the office's path was 7 cm off, with 10 % half a metre; with the track 20 % too wide 2 m.
FAR_OFF = (0.05, 0.1, math.radians(2.0))
# No wheel is taken for so much too large or small: the cameras are.
WHEELS_AT_MOST = 0.5
PARTED = (0.1, math.radians(6.0))  # m, rad


def parting_findings(parting: Parting | None) -> list[Finding]:
    """How far odometry and the matched path part; nothing where the run was too short."""
    if parting is None:
        return []
    text = (
        f"odometry and matched path part by {1000 * parting.distance:.0f} mm and "
        f"{math.degrees(parting.angle):.1f} deg in {STRETCH:g} m "
        f"(median of {parting.stretches} stretches)"
    )
    if parting.distance <= PARTED[0] and parting.angle <= PARTED[1]:
        return [Finding(text)]
    return [
        Finding(
            text,
            "one of the two is far off: check wheels, mount and calibration",
            grade=Grade.DOUBTFUL,
            short=f"odometry and images disagree by {1000 * parting.distance:.0f} mm and "
            f"{math.degrees(parting.angle):.0f} deg in every metre",
        )
    ]


def odometry_findings(
    errors: OdometryErrors | None, encoders: bool, images: bool = False
) -> list[Finding]:
    """What odometry does wrong, and its remedy; nothing where nothing is certain.

    encoders: the odometry is ours to calibrate; images: it comes from the images, or from both.
    """
    if errors is None or not errors.significant.any():
        return []
    told = errors.significant
    findings: list[Finding] = []
    if told[0]:
        findings.append(_distance(errors))
    if told[1]:
        findings.append(_rotation(errors))
    if told[2]:
        findings.append(_drift(errors))
    if encoders:
        return findings
    remedy = (
        "calibrate the cameras, or trust them less (a smaller visual.rows)"
        if images
        else "calibrate the robot's odometry, or doubt it more (odometry.heading, .along)"
    )
    findings = [replace(finding, remedy="", command="") for finding in findings]
    findings[-1] = replace(findings[-1], remedy=remedy)
    return findings


def _distance(errors: OdometryErrors) -> Finding:
    value, error = float(errors.value[0]), float(errors.error[0])
    text = f"odometry {_estimates(value)} distance by {_percent(value, error)}"
    factor = 1.0 / (1.0 + value)
    if abs(value) > WHEELS_AT_MOST:
        return Finding(
            text,
            "no wheel is so far off: look at the mount (height, pitch) and the calibration of the "
            "cameras; floor taken for obstacles moves along with the robot",
            grade=Grade.DOUBTFUL,
            short=text,
            command="beemap calibrate mount {recording}{rate_option}{rig_option} -o {new_rig} "
            "--force",
        )
    far = abs(value) > FAR_OFF[0]
    return Finding(
        text,
        f"multiply left_radius and right_radius of the encoders by {factor:.3f}",
        grade=Grade.DOUBTFUL if far else Grade.GOOD,
        short=f"{text}, or the cameras see everything too near or too far" if far else "",
        command=CALIBRATE,
    )


def _rotation(errors: OdometryErrors) -> Finding:
    value, error = errors.value[1], errors.error[1]
    # Corrected radii change the rotation, too.
    distance = errors.value[0] if errors.significant[0] else 0.0
    factor = (1.0 + value) / (1.0 + distance)
    text = f"odometry {_estimates(value)} rotation by {_percent(value, error)}"
    far = abs(value) > FAR_OFF[1]
    return Finding(
        text,
        f"multiply the track of the encoders by {factor:.3f}",
        grade=Grade.DOUBTFUL if far else Grade.GOOD,
        short=text if far else "",
        command=CALIBRATE,
    )


def _drift(errors: OdometryErrors) -> Finding:
    value, error = errors.value[2], errors.error[2]
    side, other = ("left", "right") if value > 0 else ("right", "left")
    text = (
        f"odometry turns to the {side} by {abs(math.degrees(value)):.2f} ± "
        f"{math.degrees(error):.2f} deg a metre where the robot does not"
    )
    far = abs(value) > FAR_OFF[2]
    return Finding(
        text,
        f"the {other} wheel is taken for too large ({other}_radius of the encoders), or the {side} "
        "one for too small",
        grade=Grade.DOUBTFUL if far else Grade.GOOD,
        short=text if far else "",
        command=CALIBRATE,
    )


def _estimates(error: float) -> str:
    return "overestimates" if error > 0 else "underestimates"


def _percent(value: float, error: float) -> str:
    return f"{100 * abs(value):.1f} ± {100 * error:.1f} %"
