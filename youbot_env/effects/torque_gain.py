"""Drives that deliver more or less than they report."""

from youbot_env.effects.base import Effect, Parameter


class TorqueGain(Effect):
    """Each wheel delivers (1 + e_i) times the logged torque."""

    identifier = "torque_gain"
    title = "Unequal torque constants"
    equation = r"M_i = (1 + e_i)\,M_i^{\text{log}}"
    link = "drive"
    parameters = (
        Parameter("e", "", "relative torque error", 0.1, (-0.9, 1.0),
                  per_wheel=True, contrast=True),
    )  # fmt: skip
    regime = "proportional to the torque"
    confusables = ("wheel_friction_asymmetry", "load_dependent_friction")
    experiments = ("single wheel", "fast reversals")
    order = 10

    def drive(self, p, torque, s, ops):
        """See the class."""
        return tuple(m + e * m for e, m in zip(p.e, torque, strict=True))
