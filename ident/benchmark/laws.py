"""Known phenomena under other laws than the library's: a diagnosis should name the relative.

As with the effects outside the library, none of them is registered.
"""

from __future__ import annotations

from typing import ClassVar

from youbot_env.effects import Effect, Parameter
from youbot_env.effects.presliding_friction import BRISTLE_SPEED, bent
from youbot_env.effects.wheel_coulomb_friction import WIDTH


class OtherLaw(Effect):
    """An effect of the library under another law.

    Class attributes:
        relatives: identifiers of the effects of the library that mean the same phenomenon.
    """

    relatives: ClassVar[tuple[str, ...]]


class LuGreFriction(OtherLaw):
    """Dry friction of bristles that bend before they slip (LuGre), the same on all wheels.

    State: the torque z_i of the bristles over F_c.  Their own damping is left to the wheel's
    viscous friction.
    """

    identifier = "lugre_friction"
    title = "LuGre friction of the wheels"
    equation = (
        r"\dot z_i = \tfrac{F_c}{\theta}\Bigl(\dot\varphi_i - \tfrac{|\dot\varphi_i|}"
        r"{g(\dot\varphi_i)} z_i\Bigr),\quad g = F_c + (F_s - F_c) e^{-(\dot\varphi_i/\omega_s)^2},"
        r"\quad \tau_i = -z_i"
    )
    link = "shaft"
    parameters = (
        Parameter("fc", "N m", "dry friction torque at speed", 0.2, (1e-4, 5.0)),
        Parameter("fs", "N m", "friction torque at standstill", 0.3, (1e-4, 8.0)),
        Parameter("ws", "rad/s", "Stribeck speed", 0.5, (0.1, 5.0), linear=False),
        Parameter("bend", "rad", "bend of the bristles at Fc", 0.02, (1e-3, 0.2), linear=False),
    )
    relatives = ("presliding_friction", "wheel_coulomb_friction", "stribeck_friction")

    def state_size(self, platform):
        """One share a wheel."""
        return len(platform.wheels)

    def evolve(self, p, torque, s, h, ops):
        """See ``bent``; the level is that of the present speed."""
        moved = []
        for y, w in zip(s.state, s.wheel_velocity, strict=True):
            level = 1.0 + (p.fs / p.fc - 1.0) * ops.exp(-(w / p.ws) * (w / p.ws))
            moved.append(bent(y, w, h, p.bend, level, ops))
        return tuple(moved)

    def shaft(self, p, s, ops):
        """See the class."""
        return tuple(-p.fc * y for y in s.state)

    def time_constant(self, p):
        """See the class."""
        return p.bend / BRISTLE_SPEED


class _OtherPeak(OtherLaw):
    """Stribeck friction with another fall from the static to the dynamic level."""

    link = "shaft"
    parameters = (
        Parameter("fc", "N m", "dry friction torque at speed", 0.2, (0.0, 5.0)),
        Parameter("fs", "N m", "friction torque at standstill", 0.3, (0.0, 8.0)),
        Parameter("ws", "rad/s", "Stribeck speed", 0.5, (0.1, 5.0), linear=False),
    )
    relatives = ("stribeck_friction", "wheel_coulomb_friction")

    def share(self, ratio, ops):
        """Share of the peak that is left at ``ratio`` times the Stribeck speed."""
        raise NotImplementedError

    def shaft(self, p, s, ops):
        """See the class."""
        return tuple(
            -(p.fc + (p.fs - p.fc) * self.share(w / p.ws, ops)) * ops.tanh(w / WIDTH)
            for w in s.wheel_velocity
        )


class LorentzianPeak(_OtherPeak):
    """Stribeck friction whose peak falls off as 1 / (1 + u^2)."""

    identifier = "lorentzian_peak"
    title = "Stribeck friction, Lorentzian peak"
    equation = (
        r"\tau_i = -\Bigl(F_c + \tfrac{F_s - F_c}{1 + (\dot\varphi_i/\omega_s)^2}\Bigr)"
        r"\operatorname{sgn}\dot\varphi_i"
    )

    def share(self, ratio, ops):
        """See the class."""
        return 1.0 / (1.0 + ratio * ratio)


class ExponentialPeak(_OtherPeak):
    """Stribeck friction whose peak falls off as exp(-|u|)."""

    identifier = "exponential_peak"
    title = "Stribeck friction, exponential peak"
    equation = (
        r"\tau_i = -\bigl(F_c + (F_s - F_c) e^{-|\dot\varphi_i|/\omega_s}\bigr)"
        r"\operatorname{sgn}\dot\varphi_i"
    )

    def share(self, ratio, ops):
        """See the class."""
        return ops.exp(-ops.abs(ratio))


class OtherWidthCoulomb(OtherLaw):
    """Dry friction whose sign is smoothed over another width than the library's."""

    identifier = "other_width_coulomb"
    title = "Dry friction, other smoothing"
    equation = r"\tau_i = -F_c \tanh(\dot\varphi_i / w)"
    link = "shaft"
    parameters = (
        Parameter("fc", "N m", "dry friction torque", 0.2, (0.0, 5.0)),
        Parameter("width", "rad/s", "width of the sign", 0.3, (0.01, 2.0), linear=False),
    )
    relatives = ("wheel_coulomb_friction",)

    def shaft(self, p, s, ops):
        """See the class."""
        return tuple(-p.fc * ops.tanh(w / p.width) for w in s.wheel_velocity)


LAWS = (LuGreFriction, LorentzianPeak, ExponentialPeak, OtherWidthCoulomb)
