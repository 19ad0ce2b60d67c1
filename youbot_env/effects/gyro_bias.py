"""Bias of the measured yaw rate."""

import numpy as np

from youbot_env.effects.base import Effect, Parameter


class GyroBias(Effect):
    """The gyro shows a constant rate more than there is."""

    identifier = "gyro_bias"
    title = "Bias of the gyro"
    equation = r"\Omega^{\text{log}} = \Omega + b"
    link = "sensor"
    parameters = (Parameter("b", "rad/s", "bias", 0.01, (-0.5, 0.5), scope="record"),)
    regime = "always"
    confusables = ("torque_offset", "torque_gain")
    experiments = ("wheel speeds or a pose beside the gyro", "rest at the start of the log")
    channel = "body_velocity"
    order = 21

    def record(self, p, dense):
        """See the class."""
        if "body_velocity" in dense.channels:
            dense.channels["body_velocity"] = dense.channels["body_velocity"] + (0.0, 0.0, p.b)

    def restore(self, p, rows):
        """See the class."""
        if rows.body_velocity is None:
            return rows
        return rows.changed(body_velocity=rows.body_velocity - np.array([0.0, 0.0, p.b]))
