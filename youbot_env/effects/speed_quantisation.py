"""Wheel speeds from counts of an encoder."""

import numpy as np

from youbot_env.effects.base import Effect, Parameter


class SpeedQuantisation(Effect):
    """Wheel speeds are whole multiples of a step, as differences of encoder counts are.

    A step cannot be undone; it is noise, which intervals take from the record itself.
    """

    identifier = "speed_quantisation"
    title = "Steps of the wheel speeds"
    equation = r"\varphi'^{\text{log}} = q\,\lfloor \varphi'/q + \tfrac12 \rfloor"
    link = "sensor"
    parameters = (Parameter("q", "rad/s", "step", 0.15, (0.0, 10.0), linear=False, scope="record"),)
    regime = "slow motion and standstill"
    confusables = ("stribeck_friction",)
    experiments = ("speeds from positions over a longer time",)
    candidate = False
    order = 90

    def record(self, p, dense):
        """See the class."""
        if p.q > 0 and "wheel_velocity" in dense.channels:
            speed = dense.channels["wheel_velocity"]
            dense.channels["wheel_velocity"] = np.round(speed / p.q) * p.q

    def restore(self, p, rows):
        """See the class."""
        return rows
