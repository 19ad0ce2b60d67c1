"""A floor that is not level."""

from youbot_env.effects.base import GRAVITY, Effect, Parameter


class FloorSlope(Effect):
    """Weight component along a sloping floor, fixed in the world and turned by the heading."""

    identifier = "floor_slope"
    title = "Sloping floor"
    equation = r"F = m_0\,g\,R(\psi)^{\mathsf T}(s_x, s_y)"
    link = "body"
    parameters = (
        Parameter("sx", "rad", "slope, pulling along world x", 0.01, (-0.2, 0.2), scope="record"),
        Parameter("sy", "rad", "slope, pulling along world y", 0.01, (-0.2, 0.2), scope="record"),
    )
    regime = "always; turns against the body with the heading"
    confusables = ("torque_offset", "cable_tether", "ramp")
    experiments = ("straight runs at four headings", "spin on the spot")
    needs_pose = True

    def body(self, p, s, ops):
        """See the class; the centre of mass adds a yaw moment."""
        c, n = ops.cos_sin(s.pose[2])
        gx, gy = GRAVITY * (p.sx * c + p.sy * n), GRAVITY * (p.sy * c - p.sx * n)
        return s.theta.m0 * gx, s.theta.m0 * gy, s.theta.max * gy - s.theta.may * gx
