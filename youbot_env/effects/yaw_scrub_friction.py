"""Contact patches that scrub on the floor while the robot turns."""

from youbot_env.effects.base import Effect, Parameter
from youbot_env.effects.wheel_coulomb_friction import WIDTH


class YawScrubFriction(Effect):
    """Moment of constant size against turning."""

    identifier = "yaw_scrub_friction"
    title = "Dry friction against turning"
    equation = r"M_\Omega = -T_s\,\operatorname{sgn}\Omega"
    link = "body"
    parameters = (Parameter("ts", "N m", "moment against turning", 2.0, (0.0, 50.0)),)
    regime = "turning only; a step when the turn reverses"
    confusables = ("roller_coulomb_friction", "wheel_coulomb_friction", "rolling_resistance",
                   "caster_drag")  # fmt: skip
    experiments = ("spin on the spot", "straight runs at four headings")

    def body(self, p, s, ops):
        """See the class; the smooth sign is that of the wheels of a robot that only turns."""
        wheel_speed = s.v[2] * s.platform.lever / s.platform.wheel_radius
        return 0.0, 0.0, -p.ts * ops.tanh(wheel_speed / WIDTH)
