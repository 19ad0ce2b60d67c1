"""Viscous friction that differs from wheel to wheel."""

from youbot_env.effects.base import Effect, Parameter


class WheelFrictionAsymmetry(Effect):
    """Viscous friction of single wheels beyond the common mu1."""

    identifier = "wheel_friction_asymmetry"
    title = "Unequal viscous friction of the wheels"
    equation = r"\tau_i = -\Delta\mu_i\,\dot\varphi_i"
    link = "shaft"
    parameters = (
        Parameter("dmu", "N m s", "viscous friction beyond mu1", 0.05, (-1.0, 5.0),
                  per_wheel=True, contrast=True),
    )  # fmt: skip
    regime = "grows with speed, on one wheel"
    confusables = ("torque_gain", "torque_offset")
    experiments = ("single wheel", "straight runs at several speeds")

    def shaft(self, p, s, ops):
        """See the class."""
        return tuple(-dmu * w for dmu, w in zip(p.dmu, s.wheel_velocity, strict=True))
