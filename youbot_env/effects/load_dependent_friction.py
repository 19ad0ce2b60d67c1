"""Gears that lose a share of the torque they transmit."""

from youbot_env.effects.base import Effect, Parameter
from youbot_env.effects.wheel_coulomb_friction import WIDTH


class LoadDependentFriction(Effect):
    """Friction torque in proportion to the torque the drive delivers, against the rotation."""

    identifier = "load_dependent_friction"
    title = "Friction that grows with the torque"
    equation = r"\tau_i = -k\,\lvert M_i\rvert\,\operatorname{sgn}\dot\varphi_i"
    link = "shaft"
    parameters = (Parameter("k", "", "share of the torque that is lost", 0.2, (0.0, 0.9)),)
    regime = "large torques; the gain differs between driving and braking"
    confusables = ("wheel_coulomb_friction", "torque_gain", "torque_dead_zone")
    experiments = ("fast reversals", "payload")
    torque_loss = True
    order = -10  # the gear comes first: it sees what the drive delivers

    def shaft(self, p, s, ops):
        """See the class."""
        return tuple(
            -p.k * ops.abs(m) * ops.tanh(w / WIDTH)
            for m, w in zip(s.torque, s.wheel_velocity, strict=True)
        )
