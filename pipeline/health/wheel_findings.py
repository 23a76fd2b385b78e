"""Wiring and unit faults of the encoders, in words, with their remedies."""

from __future__ import annotations

from odometry.encoders import EncoderParameters
from odometry.wheel_faults import WheelFault
from pipeline.health.finding import Finding, Grade

WHERE = "under encoders of the rig, else in odom0/sensor.yaml"


def wheel_fault_finding(
    fault: WheelFault, stated: EncoderParameters, bridged: int, steps: int
) -> Finding:
    """The finding of a run with these wheels as stated, which alone gave the motion in `bridged`
    of its steps."""
    causes, remedies = [], []
    if fault.increments:
        causes.append("the counts are those since the line before, not running totals")
        remedies.append("record running totals, or add the counts up in the file")
    if fault.exchanged:
        causes.append("left and right wheel are exchanged")
        remedies.append(
            "exchange the encoders' plugs, and map what is recorded with --ticks FILE "
            "--ticks-columns 1,3,2 --ticks-unit ns, FILE being its mav0/odom0/data.csv"
        )
    if any(fault.reversed):
        both = all(fault.reversed)
        side = "left" if fault.reversed[0] else "right"
        causes.append("both wheels count backwards" if both else f"the {side} wheel is reversed")
        wheels = [was != wrong for was, wrong in zip(stated.reversed, fault.reversed, strict=True)]
        told = ", ".join(str(wheel).lower() for wheel in wheels)
        remedies.append(f"set reversed: [{told}] {WHERE}")
    if fault.factor != 1.0:
        much = fault.factor < 1.0
        times = round(1.0 / fault.factor if much else fault.factor)
        causes.append(f"the wheels count {times} times too {'much' if much else 'little'}")
        ticks = stated.ticks_per_revolution / fault.factor
        remedies.append(f"set ticks_per_revolution: {ticks:g} {WHERE}")
    cause = " and ".join(causes)
    used = (
        f"in {bridged} of {steps} steps there was nothing else"
        if bridged
        else ("the images were used instead")
    )
    return Finding(
        f"{cause}, as the images show: {used}",
        "; ".join(remedies),
        grade=Grade.DOUBTFUL if bridged else Grade.GOOD,
        short=f"{cause}, and {used}" if bridged else "",
    )
