"""Torque that follows its command with a first-order lag."""

from youbot_env.effects.base import Effect, Parameter


class ActuatorLag(Effect):
    """First-order lag between command and delivered torque; one state a wheel."""

    identifier = "actuator_lag"
    title = "Lag of the torque"
    equation = r"T\,\dot M_i + M_i = M_i^{\text{log}}"
    link = "drive"
    parameters = (Parameter("T", "s", "time constant", 0.02, (1e-3, 0.5), linear=False),)
    regime = "changes of torque; differs from a delay above 3 Hz"
    confusables = ("actuator_delay",)
    experiments = ("chirp to 5-10 Hz",)
    late = True
    order = 60

    def state_size(self, platform):
        """One delivered torque a wheel."""
        return len(platform.wheels)

    def evolve(self, p, torque, s, h, ops):
        """Exact solution for a held command."""
        keep = ops.exp(-h / p.T)
        return tuple(m + keep * (z - m) for m, z in zip(torque, s.state, strict=True))

    def drive(self, p, torque, s, ops):
        """See the class."""
        return s.state

    def time_constant(self, p):
        """See the class."""
        return p.T
