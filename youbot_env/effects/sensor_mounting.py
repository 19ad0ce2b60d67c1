"""Where and how a sensor of the body velocity sits."""

import numpy as np

from youbot_env.effects.base import Effect, Parameter


class SensorMounting(Effect):
    """The sensor of the body velocity is turned against the body and sits away from its centre.

    It shows the velocity of its own place in its own axes; the yaw rate is the same everywhere.
    """

    identifier = "sensor_mounting"
    title = "Mounting of the velocity sensor"
    equation = r"v^{\text{log}} = R(\alpha)^\top\,(V_X - \Omega\,p_y,\; V_Y + \Omega\,p_x)^\top"
    link = "sensor"
    parameters = (
        Parameter("angle", "rad", "turned counter-clockwise by", 0.05, (-3.1416, 3.1416),
                  scope="record"),
        Parameter("px", "m", "place, forward", 0.0, (-1.0, 1.0), scope="record"),
        Parameter("py", "m", "place, to the left", 0.0, (-1.0, 1.0), scope="record"),
    )  # fmt: skip
    regime = "translation (angle), turning (place)"
    confusables = ("quadratic_drag", "floor_slope")
    experiments = ("wheel speeds or a pose beside the sensor", "spin on the spot")
    channel = "body_velocity"
    order = 30

    def record(self, p, dense):
        """See the class."""
        if "body_velocity" in dense.channels:
            vx, vy, yaw_rate = dense.channels["body_velocity"].T
            moved = vx - yaw_rate * p.py, vy + yaw_rate * p.px
            dense.channels["body_velocity"] = _turned(*moved, yaw_rate, -p.angle)

    def restore(self, p, rows):
        """See the class."""
        if rows.body_velocity is None:
            return rows
        turned = _turned(*rows.body_velocity.T, p.angle)
        turned[:, 0] += turned[:, 2] * p.py
        turned[:, 1] -= turned[:, 2] * p.px
        return rows.changed(body_velocity=turned)


def _turned(vx, vy, yaw_rate, angle) -> np.ndarray:
    """(N, 3) velocities turned counter-clockwise."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * vx - s * vy, s * vx + c * vy, yaw_rate], axis=1)
