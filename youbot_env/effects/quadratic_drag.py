"""Resistance that grows with the square of the speed."""

from youbot_env.effects.base import Effect, Parameter

# Keeps the speed differentiable at rest, (m/s)^2; a thousandth of the finest velocity reading.
TINY = 1e-12


class QuadraticDrag(Effect):
    """Force against the motion of the body, quadratic in its speed."""

    identifier = "quadratic_drag"
    title = "Quadratic drag"
    equation = r"F = -c\,\lVert V\rVert\,V"
    link = "body"
    parameters = (Parameter("c", "N s^2/m^2", "drag coefficient", 60.0, (0.0, 1000.0)),)
    regime = "high speed"
    confusables = ("wheel_coulomb_friction", "stribeck_friction", "wheel_slip", "carpet")
    experiments = ("plateaus at several speeds",)

    def body(self, p, s, ops):
        """See the class."""
        vx, vy, _ = s.v
        factor = -p.c * ops.sqrt(vx * vx + vy * vy + TINY)
        return factor * vx, factor * vy, 0.0
