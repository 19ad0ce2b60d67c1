"""Current sensors with a zero error."""

from youbot_env.effects.base import Effect, Parameter


class TorqueOffset(Effect):
    """The log shows more torque than is delivered by a constant, also at rest."""

    identifier = "torque_offset"
    title = "Zero error of the torques"
    equation = r"M_i = M_i^{\text{log}} - b_i"
    link = "drive"
    parameters = (Parameter("b", "N m", "zero error", 0.1, (-2.0, 2.0), per_wheel=True),)
    regime = "always, also at rest; does not turn with the heading"
    confusables = ("floor_slope", "wheel_friction_asymmetry", "direction_dependent_friction")
    experiments = ("spin on the spot", "straight runs at four headings")
    order = 20

    def drive(self, p, torque, s, ops):
        """See the class."""
        return tuple(m - b for b, m in zip(p.b, torque, strict=True))
