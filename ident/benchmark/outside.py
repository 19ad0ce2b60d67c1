"""Effects that no library holds: a diagnosis must not give them a name.

They are effects like all others, so the simulator runs them, but none is registered: ``get_effect``
does not know them and no candidate is made of them.
"""

from __future__ import annotations

from typing import ClassVar

from youbot_env.effects import Effect, Parameter

# Keeps directions differentiable at rest, (m/s)^2.
TINY = 1e-6


class OutsideEffect(Effect):
    """An effect that diagnosis is not to know.

    Class attributes:
        kin: effects of the library that mean the same phenomenon; they are left out of it while a
            robot with this one is diagnosed.
    """

    kin: ClassVar[tuple[str, ...]] = ()


class LateralCubicDrag(OutsideEffect):
    """Resistance against sideways motion that grows with the cube of the speed."""

    identifier = "lateral_cubic_drag"
    title = "Cubic drag sideways"
    equation = r"F_Y = -c\,V_Y^3"
    link = "body"
    parameters = (Parameter("c", "N s^3/m^3", "drag coefficient", 1500.0, (0.0, 1e6)),)

    def body(self, p, s, ops):
        """See the class."""
        vy = s.v[1]
        return 0.0, -p.c * vy * vy * vy, 0.0


class SwingingLoad(OutsideEffect):
    """A periodic push that follows the clock and nothing else."""

    identifier = "swinging_load"
    title = "Periodic push in time"
    equation = r"F = (f_x, f_y)\,\sin(\omega t + p)"
    link = "body"
    parameters = (
        Parameter("fx", "N", "push forward", 4.0, (-200.0, 200.0)),
        Parameter("fy", "N", "push to the left", 4.0, (-200.0, 200.0)),
        Parameter("w", "rad/s", "angular frequency", 5.0, (0.1, 50.0), linear=False),
        Parameter("p", "rad", "phase", 0.0, (-7.0, 7.0), linear=False),
    )
    needs_time = True

    def body(self, p, s, ops):
        """See the class."""
        swing = ops.sin(p.w * s.t + p.p)
        return p.fx * swing, p.fy * swing, 0.0


class FloorPatches(OutsideEffect):
    """Patches of sticky floor, as on tiles with a worn middle."""

    identifier = "floor_patches"
    title = "Viscous friction that depends on the place"
    equation = r"F = -c\,\sin^2(\pi x/\lambda + a)\,\sin^2(\pi y/\lambda + b)\,V"
    link = "body"
    parameters = (
        Parameter("c", "N s/m", "friction in the middle of a patch", 100.0, (0.0, 1e5)),
        Parameter("wave", "m", "distance between patches", 0.8, (0.1, 10.0), linear=False),
        Parameter("a", "rad", "phase along x", 0.0, (-7.0, 7.0), linear=False),
        Parameter("b", "rad", "phase along y", 0.0, (-7.0, 7.0), linear=False),
    )
    needs_pose = True
    kin = ("floor_patch",)

    def body(self, p, s, ops):
        """See the class."""
        k = 3.141592653589793 / p.wave
        along, across = ops.sin(k * s.pose[0] + p.a), ops.sin(k * s.pose[1] + p.b)
        factor = -p.c * along * along * across * across
        return factor * s.v[0], factor * s.v[1], 0.0


class CarpetPile(OutsideEffect):
    """A carpet whose pile resists motion against it and not along it."""

    identifier = "carpet_pile"
    title = "Friction that depends on the direction of travel in the room"
    equation = r"F = -\tfrac{c}{2}\,\bigl(1 - \cos(\chi - \chi_0)\bigr)\,V"
    link = "body"
    parameters = (
        Parameter("c", "N s/m", "friction against the pile", 80.0, (0.0, 1e5)),
        Parameter("pile", "rad", "direction of the pile in the world", 0.0, (-7.0, 7.0),
                  linear=False),
    )  # fmt: skip
    needs_pose = True
    kin = ("carpet",)

    def body(self, p, s, ops):
        """See the class; chi is the direction of the velocity in the world."""
        vx, vy, _ = s.v
        c, n = ops.cos_sin(p.pile - s.pose[2])
        along = (vx * c + vy * n) / ops.sqrt(vx * vx + vy * vy + TINY)
        factor = -0.5 * p.c * (1.0 - along)
        return factor * vx, factor * vy, 0.0


class TorqueHysteresis(OutsideEffect):
    """Torque that follows its command with play: it stays until the command is ``b`` away."""

    identifier = "torque_hysteresis"
    title = "Hysteresis of the torque"
    equation = r"M_i \in [M_i^{\text{log}} - b,\; M_i^{\text{log}} + b],\ \text{held inside}"
    link = "drive"
    parameters = (Parameter("b", "N m", "half the play", 0.1, (0.0, 2.0), linear=False),)
    order = 35

    def state_size(self, platform):
        """One delivered torque a wheel."""
        return len(platform.wheels)

    def evolve(self, p, torque, s, h, ops):
        """Follow the command at once, but only as far as the play forces it."""
        return tuple(
            ops.minimum(ops.maximum(z, m - p.b), m + p.b)
            for m, z in zip(torque, s.state, strict=True)
        )

    def drive(self, p, torque, s, ops):
        """See the class."""
        return s.state


OUTSIDE = (LateralCubicDrag, SwingingLoad, FloorPatches, CarpetPile, TorqueHysteresis)
