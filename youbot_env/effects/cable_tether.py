"""A cable that pulls the robot toward a place in the room."""

from youbot_env.effects.base import Effect, Parameter


class CableTether(Effect):
    """Spring from the origin of the world to O and a constant pull, both fixed in the world.

    Together they are a spring to the anchor ``(fx/k, fy/k)``; parametrised by the pull at the
    origin, and not by the anchor, the law is linear.  With fx = fy = 0 the cable pulls back to
    where the pose was zero, as a rule the start.
    """

    identifier = "cable_tether"
    title = "Pull of a cable"
    equation = r"F = R(\psi)^{\mathsf T}\bigl((f_x, f_y) - k\,(x, y)\bigr)"
    link = "body"
    parameters = (
        Parameter("k", "N/m", "stiffness", 5.0, (0.0, 200.0), scope="record"),
        Parameter(
            "fx", "N", "pull along world x at the origin", 0.0, (-100.0, 100.0), scope="record"
        ),
        Parameter(
            "fy", "N", "pull along world y at the origin", 0.0, (-100.0, 100.0), scope="record"
        ),
    )
    regime = "always; depends on the place"
    confusables = ("floor_slope", "torque_offset", "floor_patch", "ramp")
    contains = ("floor_slope",)
    experiments = ("straight runs at four headings", "spin on the spot")
    needs_pose = True

    def body(self, p, s, ops):
        """See the class; the cable is tied to O and turns nothing."""
        x, y, yaw = s.pose
        c, n = ops.cos(yaw), ops.sin(yaw)
        pull_x, pull_y = p.fx - p.k * x, p.fy - p.k * y
        return pull_x * c + pull_y * n, pull_y * c - pull_x * n, 0.0
