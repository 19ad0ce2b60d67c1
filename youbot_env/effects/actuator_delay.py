"""Time between command and torque."""

from youbot_env.effects.base import Effect, Parameter


class ActuatorDelay(Effect):
    """The delivered torque is the command of a moment ago."""

    identifier = "actuator_delay"
    title = "Delay of the torque"
    equation = r"M(t) = M^{\text{log}}(t - d)"
    link = "drive"
    parameters = (Parameter("d", "s", "delay", 0.02, (0.0, 0.2), linear=False),)
    regime = "changes of torque"
    confusables = ("actuator_lag",)
    experiments = ("chirp to 5-10 Hz", "fast reversals")
    late = True
    order = 50

    def delay(self, p):
        """See the class."""
        return p.d
