"""Odometry: serial bytes or recorded ticks -> wheel motion with its covariance.

from odometry.source import EncoderOdometry

odometry = EncoderOdometry(read_tick_log("data.csv"), parameters, OdometrySettings())
motion = odometry.until(stamp)
"""
