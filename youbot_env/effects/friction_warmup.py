"""Bearings and gears whose grease thins as it warms up."""

from youbot_env.effects.base import Effect, Parameter
from youbot_env.effects.battery_sag import settled


class FrictionWarmup(Effect):
    """Viscous friction of wheels and rollers falls, by one share, over the record.

    mu1 and mu2 of the robot are the cold ones, at the start of the record, from where time counts.
    """

    identifier = "friction_warmup"
    title = "Friction that falls while warming up"
    equation = r"\mu_j(t) = \mu_j\,\bigl(1 - a\,(1 - e^{-t/T})\bigr),\quad j = 1, 2"
    link = "shaft"
    parameters = (
        Parameter(
            "a", "", "share of the friction lost in the end", 0.25, (0.0, 0.95), scope="record"
        ),
        Parameter(
            "T",
            "s",
            "time constant",
            60.0,
            (5.0, 600.0),
            linear=False,
            profile=(0.25, 1.0, 5.0),
            scope="record",
        ),
    )
    regime = "drifts with time, in proportion to the speed"
    confusables = ("battery_sag", "payload_change")
    experiments = ("repeat later", "plateaus at several speeds")
    needs_time = True

    def shaft(self, p, s, ops):
        """Part of the wheels' viscous friction that is gone."""
        relief = p.a * settled(s.t, p.T, ops) * s.theta.mu1
        return tuple(relief * w for w in s.wheel_velocity)

    def roller(self, p, s, ops):
        """Part of the rollers' viscous friction that is gone."""
        relief = p.a * settled(s.t, p.T, ops) * s.theta.mu2
        return tuple(relief * rate for rate in s.roller_velocity)
