"""A battery that gives less and less."""

from youbot_env.effects.base import Effect, Parameter


def settled(t, time_constant, ops):
    """Share of a first-order change that has happened t seconds after its start."""
    return 1.0 - ops.exp(-t / time_constant)


class BatterySag(Effect):
    """The torque delivered for the same logged torque falls over the record.

    Time counts from the start of the record, where the gain is one (a common gain is invisible).
    A time constant much longer than the record makes the fall a straight line.
    """

    identifier = "battery_sag"
    title = "Sagging battery"
    equation = r"M_i = \bigl(1 - a\,(1 - e^{-t/T})\bigr)\,M_i^{\text{log}}"
    link = "drive"
    parameters = (
        Parameter(
            "a", "", "share of the torque lost in the end", 0.15, (0.0, 0.95), scope="record"
        ),
        Parameter(
            "T",
            "s",
            "time constant",
            60.0,
            (5.0, 600.0),
            linear=False,
            profile=(0.25, 1.0, 5.0),
            scope="record",
        ),
    )
    regime = "drifts with time, in proportion to the torque"
    confusables = ("friction_warmup", "payload_change", "torque_saturation")
    experiments = ("repeat later", "plateaus at several speeds")
    order = 15
    needs_time = True

    def drive(self, p, torque, s, ops):
        """See the class."""
        lost = p.a * settled(s.t, p.T, ops)
        return tuple(m - lost * m for m in torque)
