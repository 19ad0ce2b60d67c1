"""Rolling resistance of the wheels under their static loads."""

from youbot_env.dynamics import factorize, solve
from youbot_env.effects.base import GRAVITY, Effect, Parameter
from youbot_env.effects.wheel_coulomb_friction import WIDTH


def static_loads(platform, theta, ops) -> tuple:
    """Vertical forces N_i of a level floor on the wheels of a standing robot, n values, N.

    Three conditions (weight and two tilting moments) leave the loads of four wheels open; wheels
    that yield alike share them so that N_i is a plane over the wheel places.  A wheel that this
    would pull down carries nothing.
    """
    basis = [(1.0, wheel.x, wheel.y) for wheel in platform.wheels]
    pairs = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    stiffness = tuple(sum(row[i] * row[j] for row in basis) for i, j in pairs)
    a, b, c = solve(factorize(stiffness), (theta.m0, theta.max, theta.may))
    return tuple(GRAVITY * ops.maximum(a + b * x + c * y, 0.0) for _, x, y in basis)


class RollingResistance(Effect):
    """Dry friction of each wheel in proportion to the weight it carries."""

    identifier = "rolling_resistance"
    title = "Rolling resistance"
    equation = r"\tau_i = -c_{rr}\,N_i\,R\,\operatorname{sgn}\dot\varphi_i"
    link = "shaft"
    parameters = (Parameter("crr", "", "coefficient of rolling resistance", 0.02, (0.0, 0.3)),)
    regime = "all speeds; shared out between the wheels by load"
    confusables = ("wheel_coulomb_friction", "load_dependent_friction", "body_dry_friction",
                   "caster_drag")  # fmt: skip
    experiments = ("payload", "slow ramp through zero")

    def shaft(self, p, s, ops):
        """See the class; the loads are those of the robot at rest on a level floor."""
        arm = p.crr * s.platform.wheel_radius
        loads = static_loads(s.platform, s.theta, ops)
        return tuple(
            -arm * load * ops.tanh(w / WIDTH)
            for load, w in zip(loads, s.wheel_velocity, strict=True)
        )
