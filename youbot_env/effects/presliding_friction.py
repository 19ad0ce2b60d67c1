"""Dry friction whose contacts bend before they slide (Dahl 1968)."""

from youbot_env.effects.base import Effect, Parameter

# Wheel speed, rad/s, for which the time step of the bristles is chosen; their motion within a step
# is exact for a held speed, so this is about the change of speed and not about stability.
BRISTLE_SPEED = 4.0
# Keeps the rate at which bristles settle above zero at rest, 1/s.
TINY = 1e-9


def bent(state, speed, h, bend, level, ops):
    """Share of the sliding friction that bristles exert, h seconds later, the speed held.

    Exact solution of ``dy/dt = (w - |w| y / level) / bend``, which settles at ``level`` times the
    sign of w.

    Args:
        state: share now, y.
        speed: w, rad/s.
        h: time, s.
        bend: angle by which bristles bend at the sliding friction, rad.
        level: friction at this speed in units of the sliding friction.
        ops: elementary functions.
    """
    rate = ops.abs(speed) / (bend * level) + TINY
    kept = ops.exp(-rate * h)
    return state * kept + speed / bend * (1.0 - kept) / rate


class PreslidingFriction(Effect):
    """Friction of each wheel that acts as a spring until the wheel has turned by some ``bend``.

    State: for each wheel the share of the sliding friction that its bristles exert.  It is looked
    for in what plain dry friction leaves, which it may then make superfluous.
    """

    identifier = "presliding_friction"
    title = "Dry friction with presliding"
    equation = (
        r"\tau_i = -F_c\,y_i,\quad"
        r" \theta\,\dot y_i = \dot\varphi_i - \lvert\dot\varphi_i\rvert\,y_i"
    )
    link = "shaft"
    parameters = (
        Parameter("fc", "N m", "sliding friction torque of a wheel", 0.2, (0.0, 5.0)),
        Parameter("bend", "rad", "turn of the wheel in which friction comes up", 0.02,
                  (1e-3, 1.0), linear=False, profile=(1.0, 4.0)),
    )  # fmt: skip
    regime = "after each reversal, over a small turn of the wheel"
    confusables = ("wheel_coulomb_friction", "stribeck_friction", "torque_dead_zone")
    contains = ("wheel_coulomb_friction",)
    only_beside = ("wheel_coulomb_friction", "stribeck_friction")
    experiments = ("slow ramp through zero", "fast reversals")

    def state_size(self, platform):
        """One share a wheel."""
        return len(platform.wheels)

    def evolve(self, p, torque, s, h, ops):
        """See ``bent``."""
        return tuple(
            bent(y, w, h, p.bend, 1.0, ops) for y, w in zip(s.state, s.wheel_velocity, strict=True)
        )

    def shaft(self, p, s, ops):
        """See the class."""
        return tuple(-p.fc * y for y in s.state)

    def time_constant(self, p):
        """See ``BRISTLE_SPEED``."""
        return p.bend / BRISTLE_SPEED
