"""What drags on the floor wherever the robot goes: a skirt, soft rollers."""

from youbot_env.effects.base import Effect, Parameter
from youbot_env.effects.wheel_coulomb_friction import WIDTH

# Keeps the speed differentiable at rest, (m/s)^2; far below the speeds over which the sign turns.
TINY = 1e-12


def dry_drag(force, vx, vy, wheel_radius, ops) -> tuple:
    """Force of constant size, N, against a velocity, by components (N, N).

    The smooth sign is that of the wheels of a robot that drives straight at this velocity, m/s.
    """
    speed = ops.sqrt(vx * vx + vy * vy + TINY)
    factor = -force * ops.tanh(speed / (wheel_radius * WIDTH)) / speed
    return factor * vx, factor * vy


class BodyDryFriction(Effect):
    """Force of constant size against the direction of translation."""

    identifier = "body_dry_friction"
    title = "Dry friction of the body"
    equation = r"F = -F_b\,V / \lVert V\rVert"
    link = "body"
    parameters = (Parameter("fb", "N", "force against translation", 10.0, (0.0, 500.0)),)
    regime = "translation in any direction; turns round where the robot reverses"
    confusables = ("wheel_coulomb_friction", "roller_coulomb_friction", "rolling_resistance",
                   "caster_drag")  # fmt: skip
    experiments = ("straight runs at many headings", "plateaus at several speeds")

    def body(self, p, s, ops):
        """See the class."""
        vx, vy, _ = s.v
        return *dry_drag(p.fb, vx, vy, s.platform.wheel_radius, ops), 0.0
