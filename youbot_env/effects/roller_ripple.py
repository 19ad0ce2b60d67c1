"""Finite rollers: the floor is not always under the middle of a roller."""

import math

from youbot_env.effects.base import Effect, Parameter
from youbot_env.effects.roller_angle_error import deviate
from youbot_env.platform import Geometry, wheel_rows
from youbot_env.roller_rates import rate_moments

# Six rollers a wheel: each carries it over 60 degrees.
PITCH = math.pi / 3


class RollerRipple(Effect):
    """Jacobians that swing with the phase of the roller on the floor.

    With size 1 the relation of ``wheel_rows`` for a cylindrical envelope, exactly.  Rollers turn
    faster near their ends, yet mu2 stays the friction of an ideal roller of radius r that loses the
    same power on average: with and without this effect it is one number.  Left out: the
    change of J in time, which through the spin inertia gives the force ``I1 J' dJ/dt v`` (its mean
    over a roller is zero; a few newtons at 0.25 m/s), and the jerk when rollers change.
    """

    identifier = "roller_ripple"
    title = "Ripple of finite rollers"
    equation = (
        r"R\,\dot\varphi_i = V_X - \bigl(\rho_y + (R - r)\tan q_i \tan\delta_i\bigr)\Omega"
        r" + \frac{\tan\delta_i}{\cos q_i}(V_Y + \rho_x\Omega),\quad"
        r" q_i = (\varphi_i + \varphi_{0,i} + 30^\circ) \bmod 60^\circ - 30^\circ"
    )
    link = "kinematics"
    parameters = (
        Parameter("size", "", "1 is the exact relation, 0 none", 1.0, (0.0, 2.0), linear=False,
                  profile=(1.0,)),
        Parameter("phi0", "rad", "roller phase where the wheel angle is zero", 0.0,
                  (-PITCH / 2, PITCH / 2), linear=False, per_wheel=True,
                  profile=(0.0, -0.4, -0.2, 0.2, 0.4), profile_unit="roller_phase", smooth=False),
    )  # fmt: skip
    regime = "sideways motion and turning; repeats six times a wheel turn"
    confusables = ("torque_ripple", "torque_ripple_second", "wheel_slip")
    experiments = ("straight runs at four headings", "slow ramp through zero")
    order = -10
    needs_wheel_angle = True
    background = True

    @classmethod
    def complete(cls, values, platform):
        """See the base class; also refuses rollers too thin to make a round wheel by sixes."""
        large, small = platform.wheel_radius, platform.roller_radius
        thinnest = large * (1.0 - math.cos(PITCH / 2))
        if small <= thinnest:
            raise ValueError(
                f"effect {cls.identifier}: six rollers of radius {small} m cannot make a round "
                f"wheel of radius {large} m; roller_radius of platform {platform.name!r} must be "
                f"above {thinnest:.4g} m"
            )
        return super().complete(values, platform)

    def kinematics(self, p, geometry, s, ops):
        """See the class."""
        robot, rows = s.platform, []
        for wheel, angle, start in zip(robot.wheels, s.wheel_angle, p.phi0, strict=True):
            turned = (angle + start) / PITCH
            q = PITCH * (turned - ops.floor(turned + 0.5))
            rows.append(
                wheel_rows(wheel, robot.wheel_radius, robot.roller_radius, phase=q, ops=ops)
            )
        jacobian, rollers = deviate(geometry, rows, robot.geometry, p.size)[:2]
        mean, square = rate_moments(robot, PITCH / 2)
        power = 1.0 + 2.0 * p.size * (mean - 1.0) + p.size**2 * (square - 2.0 * mean + 1.0)
        equal = 1.0 / ops.sqrt(power)
        slower = tuple(tuple(equal * rate for rate in row) for row in rollers)
        return Geometry.from_rows(jacobian, slower)
