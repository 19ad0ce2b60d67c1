"""What a row of the drive input stands for."""

from youbot_env.effects.base import Effect, Parameter
from youbot_env.measurement import HOLDS


class DriveHold(Effect):
    """Whether a row of the drive input is held until the next one, or sampled, or averaged.

    Most loops run faster than their log: a row is then what the drive gave at that instant
    (sampled), or its mean since the row before (averaged).  Only a loop at the rate of the log
    holds its torque for a whole row.
    """

    identifier = "drive_hold"
    title = "Hold of the drive's rows"
    equation = r"M_k = M(t_k) \;\text{or}\; \tfrac1h\textstyle\int_{t_k - h}^{t_k} M\,dt"
    link = "sensor"
    parameters = (
        Parameter(
            "kind", "", "what a row stands for", 1.0, (0.0, 2.0), linear=False,
            profile=(0.0, 1.0, 2.0), smooth=False, scope="record", choices=HOLDS,
        ),
    )  # fmt: skip
    regime = "every change of torque; half a row of delay between one and the next"
    confusables = ("drive_offset", "actuator_delay")
    experiments = ("log at the rate of the loops",)
    candidate = False
    order = 30

    def record(self, p, dense):
        """See the class; the recorder picks the rows."""
        dense.hold = HOLDS[round(p.kind)]

    def restore(self, p, rows):
        """See the class."""
        return rows.with_drive(hold=HOLDS[round(p.kind)])
