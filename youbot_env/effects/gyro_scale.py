"""Wrong scale of the measured yaw rate."""

import numpy as np

from youbot_env.effects.base import Effect, Parameter


class GyroScale(Effect):
    """The gyro shows a share more than the yaw rate there is."""

    identifier = "gyro_scale"
    title = "Scale of the gyro"
    equation = r"\Omega^{\text{log}} = (1 + k)\,\Omega"
    link = "sensor"
    parameters = (Parameter("k", "", "error of the scale", 0.02, (-0.5, 0.5), scope="record"),)
    regime = "turning"
    confusables = ("base_geometry_error",)
    experiments = ("wheel speeds or a pose beside the gyro",)
    channel = "body_velocity"
    order = 20

    def record(self, p, dense):
        """See the class."""
        if "body_velocity" in dense.channels:
            dense.channels["body_velocity"] = dense.channels["body_velocity"] * (1, 1, 1 + p.k)

    def restore(self, p, rows):
        """See the class."""
        if rows.body_velocity is None:
            return rows
        return rows.changed(body_velocity=rows.body_velocity / np.array([1.0, 1.0, 1.0 + p.k]))
