"""The wheel-speed loops on board of the robot: the kinematic level of control."""

from __future__ import annotations

from dataclasses import dataclass

from youbot_env.backend import Ops


@dataclass(frozen=True)
class WheelLoop:
    """One PI speed loop a wheel, the same gains for every comparison.

    One wheel of the youBot carries about m0 R^2/4 + I1 = 0.026 kg m^2 forward.  kp = 0.8 N m s/rad
    gives a bandwidth near 30 rad/s (5 Hz), about a third of what a loop sampled at 100 Hz could
    hold before its phase suffers, and turns wheel-speed noise of 0.02 rad/s into 0.016 N m, half
    the noise of the torque itself.  ki places the zero at 5 rad/s, near the friction's own rate.

    Attributes:
        kp: proportional gain, N m s/rad.
        ki: integral gain, N m/rad.
        limit: largest torque, N m.
    """

    kp: float = 0.8
    ki: float = 4.0
    limit: float = 4.0

    def torque(self, reference: tuple, measured: tuple, integral: tuple, dt, ops: Ops):
        """Return ``(torques N m, integrals N m)`` for n reference and measured speeds, rad/s.

        The integral is set back to what keeps the sum at the limit, so it cannot wind up.
        """
        torques, integrals = [], []
        for wanted, speed, part in zip(reference, measured, integral, strict=True):
            error = wanted - speed
            total = self.kp * error + part + (self.ki * dt) * error
            clipped = ops.minimum(ops.maximum(total, -self.limit), self.limit)
            torques.append(clipped)
            integrals.append(clipped - self.kp * error)
        return tuple(torques), tuple(integrals)
