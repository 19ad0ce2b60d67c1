"""Dry friction in the wheel bearings and gears."""

from youbot_env.effects.base import Effect, Parameter

# Width of the smooth sign in simulation, rad/s.  The driver resolves 0.004 rad/s and its noise is
# 0.02 rad/s: a narrower step could not be told from this one and would only cost time steps.
WIDTH = 0.1


class WheelCoulombFriction(Effect):
    """Torque of constant size against the rotation of each wheel."""

    identifier = "wheel_coulomb_friction"
    title = "Dry friction of the wheels"
    equation = r"\tau_i = -F_{c,i}\,\operatorname{sgn}\dot\varphi_i"
    link = "shaft"
    parameters = (Parameter("fc", "N m", "dry friction torque", 0.2, (0.0, 5.0), per_wheel=True),)
    regime = "all speeds; a step when a wheel reverses"
    confusables = ("stribeck_friction", "rolling_resistance", "torque_dead_zone",
                   "load_dependent_friction", "body_dry_friction", "caster_drag",
                   "direction_dependent_friction", "presliding_friction")  # fmt: skip
    experiments = ("slow ramp through zero", "plateaus at several speeds")

    def shaft(self, p, s, ops):
        """See the class."""
        return tuple(
            -fc * ops.tanh(w / WIDTH) for fc, w in zip(p.fc, s.wheel_velocity, strict=True)
        )
