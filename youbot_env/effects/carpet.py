"""A carpet: it resists motion more across its ribs than along them, and more against its nap."""

import math

from youbot_env.effects.base import Effect, Parameter

# Keeps the direction of the nap's part differentiable at rest, (m/s)^2.
TINY = 1e-6
# Share of the resistance by which noise may make the floor push the robot.
NOISE = 0.1


class Carpet(Effect):
    """Viscous friction against translation that depends on its direction in the world.

    A symmetric tensor (c) gives the ribs: as much one way as back.  The nap (n) lies in one
    direction, along which motion is as much easier as it is harder against it.
    """

    identifier = "carpet"
    title = "Carpet with ribs and nap"
    equation = (
        r"F = R(\psi)^{\mathsf T}\Bigl(-\begin{pmatrix}c_x & c_{xy}\\ c_{xy} & c_y\end{pmatrix} w"
        r" + \frac{n\cdot w}{\lVert w\rVert}\,w\Bigr),\quad w = R(\psi)\,V"
    )
    link = "body"
    parameters = (
        Parameter("cx", "N s/m", "friction against motion along world x", 50.0, (0.0, 1000.0),
                  scope="record"),
        Parameter("cy", "N s/m", "friction against motion along world y", 50.0, (0.0, 1000.0),
                  scope="record"),
        Parameter("cxy", "N s/m", "turns the ribs away from the axes", 0.0, (-500.0, 500.0),
                  scope="record"),
        Parameter("nx", "N s/m", "nap: relief along world x", 20.0, (-500.0, 500.0),
                  scope="record"),
        Parameter("ny", "N s/m", "nap: relief along world y", 0.0, (-500.0, 500.0),
                  scope="record"),
    )  # fmt: skip
    regime = "translation; depends on its direction in the world"
    confusables = ("floor_patch", "quadratic_drag")
    experiments = ("straight runs at four headings",)
    needs_pose = True

    def body(self, p, s, ops):
        """See the class."""
        vx, vy, _ = s.v
        c, n = ops.cos_sin(s.pose[2])
        wx, wy = c * vx - n * vy, n * vx + c * vy
        eased = (p.nx * wx + p.ny * wy) / ops.sqrt(vx * vx + vy * vy + TINY)
        fx = eased * wx - p.cx * wx - p.cxy * wy
        fy = eased * wy - p.cxy * wx - p.cy * wy
        return c * fx + n * fy, c * fy - n * fx, 0.0

    def plausible(self, values):
        """A floor pushes nobody: what resists least is at least the relief along the nap."""
        mean = 0.5 * (values["cx"] + values["cy"])
        least = mean - math.hypot(0.5 * (values["cx"] - values["cy"]), values["cxy"])
        return least >= math.hypot(values["nx"], values["ny"]) - NOISE * 2.0 * mean
