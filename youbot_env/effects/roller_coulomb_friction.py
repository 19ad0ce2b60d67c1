"""Dry friction in the roller bearings."""

from youbot_env.effects.base import Effect, Parameter

# Rollers turn R/r times faster than wheels, so their smooth sign is wider in the same ratio.
WIDTH = 0.3


class RollerCoulombFriction(Effect):
    """Torque of constant size against the rotation of the rollers: sideways and yaw only."""

    identifier = "roller_coulomb_friction"
    title = "Dry friction of the rollers"
    equation = r"Q = -G^{\mathsf T}\,T_c\,\operatorname{sgn}\dot\gamma"
    link = "roller"
    parameters = (Parameter("tc", "N m", "dry friction torque of a roller", 0.012, (0.0, 0.5)),)
    regime = "sideways motion and turning"
    confusables = ("yaw_scrub_friction", "body_dry_friction", "caster_drag")
    experiments = ("straight runs at four headings", "spin on the spot")

    def roller(self, p, s, ops):
        """See the class."""
        return tuple(-p.tc * ops.tanh(rate / WIDTH) for rate in s.roller_velocity)
