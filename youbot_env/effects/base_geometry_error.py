"""Wheels farther from the centre, or nearer to it, than the drawing says."""

from youbot_env.effects.base import Effect, Parameter
from youbot_env.platform import Geometry


class BaseGeometryError(Effect):
    """Track and wheel base, and with them L, larger by one share; wheel data cannot show it."""

    identifier = "base_geometry_error"
    title = "Wrong distance between the wheels"
    equation = r"L \to L\,(1 + e),\quad \rho_i \to \rho_i\,(1 + e)"
    link = "kinematics"
    parameters = (
        Parameter("e", "", "relative error of the distances", 0.02, (-0.3, 0.3), linear=False),
    )
    regime = "turning; only against the pose"
    seen_by_wheels = False
    confusables = ("roller_angle_error", "wheel_radius_error")
    experiments = ("spin on the spot",)

    def kinematics(self, p, geometry, s, ops):
        """See the class; J and G hold distances in their columns of Omega alone."""

        def stretch(rows):
            return tuple((x, y, turn * (1.0 + p.e)) for x, y, turn in rows)

        return Geometry.from_rows(stretch(geometry.jacobian), stretch(geometry.roller_jacobian))
