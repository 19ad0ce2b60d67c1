"""Rollers mounted at another angle than the drawing says."""

from youbot_env.effects.base import Effect, Parameter
from youbot_env.platform import Geometry, wheel_rows


def deviate(geometry: Geometry, rows, ideal: Geometry, size=1.0) -> Geometry:
    """Add to a geometry what rows differ from ideal ones, so that several deviations add up.

    Args:
        geometry: as other effects have left it.
        rows: for each wheel the rows of J and G, as ``wheel_rows`` returns them.
        ideal: what the rows are compared with.
        size: factor on the difference.
    """
    both = zip(*rows, strict=True)
    changed = [
        tuple(
            tuple(a + size * (b - c) for a, b, c in zip(*three, strict=True))
            for three in zip(own, new, old, strict=True)
        )
        for own, new, old in zip(geometry[:2], both, ideal[:2], strict=True)
    ]
    return Geometry.from_rows(*changed)


class RollerAngleError(Effect):
    """Roller angles delta_i + e_i in the kinematics; best seen against an independent pose."""

    identifier = "roller_angle_error"
    title = "Wrong roller angles"
    equation = r"\delta_i \to \delta_i + e_i"
    link = "kinematics"
    parameters = (
        Parameter("e", "rad", "error of the roller angle", 0.02, (-0.3, 0.3), linear=False,
                  per_wheel=True),
    )  # fmt: skip
    regime = "sideways motion and turning; best seen against the pose"
    seen_by_wheels = False
    confusables = ("base_geometry_error", "wheel_radius_error")
    experiments = ("straight runs at four headings",)
    order = -20

    def kinematics(self, p, geometry, s, ops):
        """See the class."""
        robot = s.platform
        rows = [
            wheel_rows(wheel, robot.wheel_radius, robot.roller_radius, offset=e, ops=ops)
            for wheel, e in zip(robot.wheels, p.e, strict=True)
        ]
        return deviate(geometry, rows, robot.geometry)
