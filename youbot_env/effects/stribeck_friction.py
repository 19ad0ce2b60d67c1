"""Dry friction that is larger near standstill."""

from youbot_env.effects.base import Effect, Parameter
from youbot_env.effects.wheel_coulomb_friction import WIDTH

# Share of the largest friction that noise may put where there is none.
NOISE = 0.1


class StribeckFriction(Effect):
    """Friction that falls from a static to a dynamic level as a wheel starts to turn."""

    identifier = "stribeck_friction"
    title = "Dry friction with Stribeck peak"
    equation = (
        r"\tau_i = -\bigl(F_c + (F_s - F_c)\,e^{-(\dot\varphi_i/\omega_s)^2}\bigr)"
        r"\operatorname{sgn}\dot\varphi_i"
    )
    link = "shaft"
    parameters = (
        Parameter("fc", "N m", "dry friction torque at speed", 0.2, (0.0, 5.0), per_wheel=True),
        Parameter("fs", "N m", "friction torque at standstill", 0.3, (0.0, 8.0), per_wheel=True),
        Parameter(
            "ws",
            "rad/s",
            "Stribeck speed",
            0.5,
            (0.1, 5.0),
            linear=False,
            profile=(0.5, 1.0, 2.0, 4.0),
        ),
    )
    regime = "reversals and slow motion"
    confusables = ("wheel_coulomb_friction", "torque_dead_zone", "presliding_friction")
    contains = ("wheel_coulomb_friction",)
    experiments = ("slow ramp through zero", "fast reversals")

    def shaft(self, p, s, ops):
        """See the class."""
        torques = []
        for fc, fs, w in zip(p.fc, p.fs, s.wheel_velocity, strict=True):
            ratio = w / p.ws
            level = fc + (fs - fc) * ops.exp(-ratio * ratio)
            torques.append(-level * ops.tanh(w / WIDTH))
        return tuple(torques)

    def plausible(self, values):
        """Static friction is the larger one; the other way round it is another law.

        Noise may turn it round on wheels that have hardly any.
        """
        slack = NOISE * max(v for name, v in values.items() if name != "ws")
        return all(
            values[name.replace("fc", "fs")] >= value - slack
            for name, value in values.items()
            if name.startswith("fc")
        )
