"""Dry friction that is not the same forward and backward."""

from youbot_env.effects.base import Effect, Parameter
from youbot_env.effects.wheel_coulomb_friction import WIDTH


class DirectionDependentFriction(Effect):
    """Dry friction of the wheels with one level for forward and one for backward rotation.

    Seals, brushes and gears have it (Armstrong-Helouvry, Dupont and Canudas de Wit 1994).  A wheel
    that turns sees half of the difference as a constant torque; only at rest is that gone, where a
    zero error of the torque stays.  The same for all wheels: eight levels would explain any force
    that changes slowly with the motion (a slope where the robot turns little).
    """

    identifier = "direction_dependent_friction"
    title = "Dry friction that depends on the direction"
    equation = (
        r"\tau_i = -F_+\,\max(\operatorname{sgn}\dot\varphi_i, 0)"
        r" - F_-\,\min(\operatorname{sgn}\dot\varphi_i, 0)"
    )
    link = "shaft"
    parameters = (
        Parameter("forward", "N m", "friction torque of wheels turning forward", 0.2, (0.0, 5.0)),
        Parameter("backward", "N m", "friction torque of wheels turning back", 0.3, (0.0, 5.0)),
    )  # fmt: skip
    regime = "all speeds; a step when a wheel reverses, of which zero is not the middle"
    confusables = ("wheel_coulomb_friction", "torque_offset")
    contains = ("wheel_coulomb_friction",)
    experiments = ("slow ramp through zero", "plateaus at several speeds")

    def shaft(self, p, s, ops):
        """See the class."""
        torques = []
        for w in s.wheel_velocity:
            sign = ops.tanh(w / WIDTH)
            torques.append(
                -p.forward * ops.maximum(sign, 0.0) - p.backward * ops.minimum(sign, 0.0)
            )
        return tuple(torques)
