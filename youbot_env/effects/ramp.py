"""A ramp: level floor up to an edge, sloping floor beyond."""

from youbot_env.effects.base import GRAVITY, Effect, Parameter
from youbot_env.effects.floor_patch import EDGE, beyond_edge


class Ramp(Effect):
    """Weight component against the edge's normal, once the robot is beyond the edge.

    It grows over half a wheelbase before and behind the edge, while the axles pass.  Left out: the
    pitch of the robot on its way over the edge and the load that moves between the axles.
    """

    identifier = "ramp"
    title = "Ramp"
    equation = (
        r"F = -m_0\,g\,s\,R(\psi)^{\mathsf T}(\cos\alpha, \sin\alpha) \;\text{where}\;"
        r" x \cos\alpha + y \sin\alpha > d"
    )
    link = "body"
    parameters = (
        Parameter("s", "rad", "slope beyond the edge, uphill along its normal", 0.02, (-0.3, 0.3),
                  scope="record"),
        *EDGE,
    )  # fmt: skip
    regime = "always, beyond an edge"
    confusables = ("floor_slope", "cable_tether", "floor_patch")
    contains = ("floor_slope",)
    experiments = ("straight runs at four headings", "repeat later")
    needs_pose = True

    def body(self, p, s, ops):
        """See the class; the centre of mass adds a yaw moment."""
        x, y, yaw = s.pose
        half = max(abs(wheel.x) for wheel in s.platform.wheels)
        pull = -GRAVITY * p.s * beyond_edge(x, y, p, half, ops)
        gx, gy = pull * ops.cos(p.angle - yaw), pull * ops.sin(p.angle - yaw)
        return s.theta.m0 * gx, s.theta.m0 * gy, s.theta.max * gy - s.theta.may * gx
