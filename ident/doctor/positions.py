"""Wheel angles against wheel speeds: the stock ROS driver negates one and not the other."""

from __future__ import annotations

import numpy as np

from ident.doctor.record import Record

MOVING = 0.2  # of its rms, above which the sign of a speed counts
OPPOSITE = 0.2  # share of agreeing signs below which they are opposite
ROLLING = 0.15  # rms of what contradicts rolling, over the rms of wheel speeds


def check_positions(record: Record) -> None:
    """Give wheel speeds the signs of wheel angles where these roll and the speeds do not."""
    angle, speed = record.get("wheel_position"), record.get("wheel_velocity")
    if angle is None or speed is None:
        return
    rate = np.gradient(angle, record.time, axis=0)
    moving = np.abs(speed) > MOVING * np.sqrt(np.mean(speed**2, axis=0))
    agree = np.ma.masked_array(np.sign(rate) == np.sign(speed), ~moving).mean(axis=0).filled(1.0)
    opposite = np.flatnonzero(agree < OPPOSITE)
    if not len(opposite):
        return
    flipped = speed.copy()
    flipped[:, opposite] *= -1
    what = "speed and change of angle have opposite signs"
    where = record.name("wheel_velocity", opposite)
    if _contradiction(record, speed) > ROLLING > _contradiction(record, flipped):
        record.set("wheel_velocity", flipped)
        record.fixed(
            "signs", what, where, "the angles roll without slip, the speeds took their signs"
        )
    else:
        record.warn("signs", what, where, "check the signs of both; the angles were not used")


def _contradiction(record: Record, speed: np.ndarray) -> float:
    """Rms of the part of wheel speeds that cannot roll, over their rms."""
    J = record.platform.jacobian_array
    left = speed - speed @ (J @ np.linalg.pinv(J)).T
    return float(np.sqrt(np.mean(left**2) / np.mean(speed**2)))
