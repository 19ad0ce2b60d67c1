"""Drives that cannot deliver what is asked."""

from youbot_env.effects.base import Effect, Parameter


class TorqueSaturation(Effect):
    """Delivered torque is clipped at the current limit."""

    identifier = "torque_saturation"
    title = "Torque limit"
    equation = r"M_i = \operatorname{sat}(M_i^{\text{log}}, M_{\max})"
    link = "drive"
    parameters = (Parameter("limit", "N m", "largest torque", 3.0, (0.05, 50.0), linear=False,
                            profile=tuple(k / 10 for k in range(3, 10)),
                            profile_unit="peak"),)  # fmt: skip
    regime = "large torques"
    confusables = ("battery_sag",)
    experiments = ("fast reversals",)
    order = 40

    def drive(self, p, torque, s, ops):
        """See the class."""
        return tuple(ops.minimum(ops.maximum(m, -p.limit), p.limit) for m in torque)
