"""Drives that need some torque before they move anything."""

from youbot_env.effects.base import Effect, Parameter


class TorqueDeadZone(Effect):
    """No torque below a threshold, and the threshold missing above it (a continuous dead zone)."""

    identifier = "torque_dead_zone"
    title = "Dead zone of the torques"
    equation = r"M_i = M_i^{\text{log}} - \operatorname{sat}(M_i^{\text{log}}, M_0)"
    link = "drive"
    parameters = (
        Parameter("threshold", "N m", "torque that moves nothing", 0.2, (0.0, 5.0), linear=False,
                  profile=(0.03, 0.06, 0.12, 0.25), profile_unit="command"),
    )  # fmt: skip
    regime = "small torques and their reversals"
    confusables = ("wheel_coulomb_friction", "stribeck_friction", "load_dependent_friction",
                   "presliding_friction")  # fmt: skip
    experiments = ("slow ramp through zero", "fast reversals")
    order = 30

    def drive(self, p, torque, s, ops):
        """See the class."""
        return tuple(m - ops.minimum(ops.maximum(m, -p.threshold), p.threshold) for m in torque)
