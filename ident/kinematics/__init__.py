"""Kinematic calibration: what wheels and an independently measured pose say about a platform."""

from ident.kinematics.calibration import KinematicCalibration, calibrate_kinematics
from ident.kinematics.drift import Drift

__all__ = ["Drift", "KinematicCalibration", "calibrate_kinematics"]
