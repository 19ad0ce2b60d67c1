"""Wheels of unequal radius."""

from youbot_env.effects.base import Effect, Parameter
from youbot_env.platform import Geometry


class WheelRadiusError(Effect):
    """Wheel i rolls on the radius R (1 + e_i); the error common to all wheels is invisible."""

    identifier = "wheel_radius_error"
    title = "Unequal wheel radii"
    equation = r"R_i = R\,(1 + e_i)"
    link = "kinematics"
    parameters = (
        Parameter("e", "", "relative error of the radius", 0.03, (-0.3, 0.3), linear=False,
                  per_wheel=True, contrast=True),
    )  # fmt: skip
    regime = (
        "all motion; wheel speeds contradict each other as V_X grows, odometry turns against pose"
    )
    confusables = ("wheel_slip", "roller_angle_error", "torque_gain")
    experiments = ("straight runs at four headings", "single wheel")

    def kinematics(self, p, geometry, s, ops):
        """See the class."""
        rows = tuple(
            tuple(entry / (1.0 + e) for entry in row)
            for row, e in zip(geometry.jacobian, p.e, strict=True)
        )
        return Geometry.from_rows(rows, geometry.roller_jacobian)
