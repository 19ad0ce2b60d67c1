"""A passive caster, or a foot, that drags at one point of the robot."""

from youbot_env.effects.base import Effect, Parameter
from youbot_env.effects.body_dry_friction import dry_drag


class CasterDrag(Effect):
    """Force of constant size against the motion of the caster's own point on the floor.

    Quasi-static: the caster is taken to point where it is drawn.  Left out is the swivel, which
    for a trail of 20 mm is over after some 60 mm of way (three trails: the angle of a dragged wheel
    decays as ``exp(-way / trail)``).
    """

    identifier = "caster_drag"
    title = "Drag of a caster"
    equation = (
        r"F = -F_c\,u / \lVert u\rVert,\quad u = (V_X - \Omega\,p_y,\; V_Y + \Omega\,p_x),\quad"
        r" M_\Omega = p_x F_Y - p_y F_X"
    )
    link = "body"
    parameters = (
        Parameter("fc", "N", "force against the motion of the caster", 10.0, (0.0, 500.0)),
        Parameter("px", "m", "place of the caster, forward", -0.3, (-1.0, 1.0), linear=False,
                  profile=(1.0, -1.0)),
        Parameter("py", "m", "place of the caster, to the left", 0.0, (-1.0, 1.0), linear=False,
                  profile=(0.0,)),
    )  # fmt: skip
    regime = "translation and turning; the force swings round with the motion of one point"
    confusables = ("body_dry_friction", "yaw_scrub_friction", "wheel_coulomb_friction",
                   "roller_coulomb_friction", "rolling_resistance")  # fmt: skip
    contains = ("body_dry_friction",)
    experiments = ("spin on the spot", "straight runs at four headings")

    def body(self, p, s, ops):
        """See the class."""
        vx, vy, om = s.v
        moved = vx - om * p.py, vy + om * p.px
        fx, fy = dry_drag(p.fc, *moved, s.platform.wheel_radius, ops)
        return fx, fy, p.px * fy - p.py * fx
