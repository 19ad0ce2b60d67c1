"""A floor that is another one beyond an edge: tiles end, a carpet begins, something was spilt."""

import math

from youbot_env.effects.base import Effect, Parameter

# Half the way, m, over which a wheel of some 10 mm of contact and a tilted edge change the floor.
WIDTH = 0.03
# Where edges are looked for: normals over half a turn, as a jump may have either sign, and
# distances from the origin as shares of what the robot covers.
NORMALS = (0.0, math.pi / 3, 2 * math.pi / 3)
DISTANCES = (0.02, -0.02, 0.1, -0.1, 0.45, -0.45)

EDGE = (
    Parameter("angle", "rad", "direction of the edge's normal in the world", 0.0, (-3.2, 3.2),
              linear=False, profile=NORMALS, crossed=True, scope="record"),
    Parameter("dist", "m", "distance of the edge from the origin along the normal", 0.2,
              (-50.0, 50.0), linear=False, profile=DISTANCES, profile_unit="reach", crossed=True,
              scope="record"),
)  # fmt: skip


def beyond_edge(x, y, p, width, ops):
    """How far a point of the world (m) is beyond the edge of ``EDGE``: 0 before it, 1 behind.

    ``width`` is half the way, m, over which the one becomes the other.
    """
    along = x * ops.cos(p.angle) + y * ops.sin(p.angle) - p.dist
    return 0.5 + 0.5 * ops.tanh(along / width)


class FloorPatch(Effect):
    """More (or less) viscous friction of each wheel that stands beyond a straight edge."""

    identifier = "floor_patch"
    title = "Friction that depends on the place"
    equation = (
        r"\tau_i = -\Delta\mu\,\dot\varphi_i \;\text{where}\;"
        r" x_i \cos\alpha + y_i \sin\alpha > d"
    )
    link = "shaft"
    parameters = (
        Parameter("dmu", "N m s", "viscous friction beyond mu1 behind the edge", 0.1, (-1.0, 5.0),
                  scope="record"),
        *EDGE,
    )  # fmt: skip
    regime = "all speeds; changes with the place"
    confusables = ("carpet", "cable_tether", "ramp")
    experiments = ("straight runs at four headings", "repeat later")
    needs_pose = True

    def shaft(self, p, s, ops):
        """See the class."""
        x, y, yaw = s.pose
        c, n = ops.cos_sin(yaw)
        torques = []
        for wheel, w in zip(s.platform.wheels, s.wheel_velocity, strict=True):
            place = x + c * wheel.x - n * wheel.y, y + n * wheel.x + c * wheel.y
            torques.append(-p.dmu * beyond_edge(*place, p, WIDTH, ops) * w)
        return tuple(torques)
