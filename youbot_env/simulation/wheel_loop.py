"""The wheel-speed loops on board of the robot: the kinematic level of control."""

from __future__ import annotations

from dataclasses import dataclass

from youbot_env.arguments import check_number
from youbot_env.backend import Ops


@dataclass(frozen=True)
class WheelLoop:
    """One PI speed loop a wheel, the same gains for every comparison.

    One wheel of the youBot carries about m0 R^2/4 + I1 = 0.026 kg m^2 forward.  kp = 0.8 N m s/rad
    gives a bandwidth near 30 rad/s (5 Hz), about a third of what a loop sampled at 100 Hz could
    hold before its phase suffers, and turns wheel-speed noise of 0.02 rad/s into 0.016 N m, half
    the noise of the torque itself.  ki places the zero at 5 rad/s, near the friction's own rate.

    The integral leaks.  Four loops on one platform share a load that has three freedoms: what their
    integrals hold against each other moves nothing, shows in no speed and would stay for ever.
    Drives that turn one load are therefore given a droop, a speed that falls a little with torque;
    one to three per cent at full torque are usual.  A leak is a droop for slow changes alone: a
    steady torque M costs ``M / (kp + ki leak)``.  With 5 s the largest torque costs 0.19 rad/s,
    1.1 % of the wheels' 17 rad/s, a cruise of 0.3 m/s some 0.05 rad/s, and the motions of a record,
    which change within seconds, nothing.

    Attributes:
        kp: proportional gain, N m s/rad.
        ki: integral gain, N m/rad.
        limit: largest torque, N m.
        leak: time in which the integral forgets, s; infinite for a perfect integrator.
    """

    kp: float = 0.8
    ki: float = 4.0
    limit: float = 4.0
    leak: float = 5.0

    def __post_init__(self) -> None:
        for name, low in (("kp", 0.0), ("ki", 0.0), ("limit", 0.0), ("leak", 1e-3)):
            check_number(name, getattr(self, name), low)

    def torque(self, reference: tuple, measured: tuple, integral: tuple, dt, ops: Ops):
        """Return ``(torques N m, integrals N m)`` for n reference and measured speeds, rad/s.

        The integral is set back to what keeps the sum at the limit, so it cannot wind up.
        """
        torques, integrals = [], []
        for wanted, speed, part in zip(reference, measured, integral, strict=True):
            error = wanted - speed
            total = self.kp * error + (1.0 - dt / self.leak) * part + (self.ki * dt) * error
            clipped = ops.minimum(ops.maximum(total, -self.limit), self.limit)
            torques.append(clipped)
            integrals.append(clipped - self.kp * error)
        return tuple(torques), tuple(integrals)
