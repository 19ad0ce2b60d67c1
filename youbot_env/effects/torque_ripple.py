"""Torque that repeats with the angle of the wheel."""

from youbot_env.backend import is_zero
from youbot_env.effects.base import Effect, Parameter


class TorqueRipple(Effect):
    """One harmonic of the wheel angle added to the shaft torque.

    Its amplitude is ``hypot(a, b)``; cosine and sine parts, unlike amplitude and phase, make the
    law linear.  The order k is 6 for rollers, gear ratio times poles for a motor, and need not be
    an integer.  Angles count from the start of the record: each wheel has a phase of its own.
    """

    identifier = "torque_ripple"
    title = "Torque ripple"
    equation = r"\tau_i = a_i \cos k\varphi_i + b_i \sin k\varphi_i"
    link = "shaft"
    parameters = (
        Parameter("a", "N m", "cosine amplitude", 0.15, (-3.0, 3.0), per_wheel=True),
        Parameter("b", "N m", "sine amplitude", 0.15, (-3.0, 3.0), per_wheel=True),
        Parameter(
            "k",
            "",
            "periods a turn of the wheel",
            6.0,
            (0.5, 300.0),
            linear=False,
            profile_unit="order",
        ),
    )
    regime = "repeats with the wheel angle"
    confusables = ("roller_ripple", "torque_ripple_second")
    experiments = ("single wheel", "slow ramp through zero", "plateaus at several speeds")
    needs_wheel_angle = True

    def shaft(self, p, s, ops):
        """See the class."""
        # A diagnosis tries one wheel at a time: sines of the others are most of what that costs.
        return tuple(
            0.0
            if is_zero(a) and is_zero(b)
            else a * ops.cos(p.k * angle) + b * ops.sin(p.k * angle)
            for a, b, angle in zip(p.a, p.b, s.wheel_angle, strict=True)
        )
