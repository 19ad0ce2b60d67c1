"""Another order of torque ripple beside the first."""

from youbot_env.effects.torque_ripple import TorqueRipple


class TorqueRippleSecond(TorqueRipple):
    """A second harmonic of the wheel angle, with an order of its own.

    Motor poles and gear teeth make ripples of unrelated orders.  Its law is that of the first; it
    is looked for once the first is found, in what that one leaves.
    """

    identifier = "torque_ripple_second"
    title = "Torque ripple of a second order"
    confusables = ("torque_ripple", "roller_ripple")
    only_beside = ("torque_ripple",)
