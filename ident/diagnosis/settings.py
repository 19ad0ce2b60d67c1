"""All thresholds of the diagnosis, each with the measurement that set it, where one did."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """What decides in a diagnosis; shares are of squared errors unless said otherwise."""

    # --- Whether logs can decide anything
    # What a record must offer before anything is named.
    least_seconds: float = 20.0
    least_speed: float = 0.03
    # Of longer records this much is used, s, in stretches of about that length: the liveliest.  Of
    # an hour of many motions 75, 150, 300, 600 and 1200 s gave the size of a dry friction within
    # 1.1, 0.6, 0.4, 0.2 and 0.1 %; the smallest size seen of other effects fell up to 300 s and no
    # further, as what it hides behind is no noise.  600 s take 0.8 GB, and 1200 s twice the time.
    most_seconds: float = 600.0
    # Files are cut to this much, s, before anything is done with them: identification of an hour
    # took 1.2 GB, of this 0.7.
    longest_seconds: float = 1800.0
    excerpt_seconds: float = 20.0
    # A wheel at its largest torque for more than this share of the time has flat tops.
    most_clipped: float = 0.05

    # --- What windows are for
    # Of a second log this share, from its start, helps to choose; the rest is kept for the end.
    choosing: float = 0.6
    # A second log with fewer windows than this is all kept for the end.
    fewest_windows: int = 8
    # Where there is no second log, every so many windows of the first are kept for the end; of so
    # many runs or more, whole ones.
    kept_every: int = 5
    # An axis of which noise leaves no more than this share of its error hardly counts.
    least_axis_share: float = 0.05

    # --- Which error judges
    # Length of the windows in which forces are judged, s, or one sample: a light robot whose
    # friction is wrong by all of it stops within a tenth of a second, and then shows nothing more.
    force_window: float = 0.03
    # Length of the moving mean of drive and velocities, s.
    force_mean: float = 0.5
    # Median change of speed, in its rms a second, below which a motion counts as steady: a circle
    # has 0.001, a slow joystick 0.4, calibration motions 0.6 to 1.9.
    steady_motion: float = 0.15

    # --- Orders of the wheel angle
    # Orders looked at, periods a turn: slower ones are the motion itself.
    lowest_order: float = 0.8
    highest_order: float = 24.0
    # Bins of the angle, rad, fine enough for the highest order, and length of the transform.
    angle_bin: float = 0.04
    transform_length: int = 1 << 16

    # --- The table of scores
    # Blocks of each log that are left out in turn: in a calibration log these are its motions.
    table_blocks: int = 4
    # Memory of the traces that are made at a time, before they are averaged; some times as much is
    # in use meanwhile.
    most_bytes: int = 1 << 25
    # Shrinks the coefficients of dependences, which have many.
    ridge: float = 1e-3
    # Share of squared error by which a dependence is plain.
    plain_share: float = 0.5
    # Coefficients of laws that are not linear, in units of the size that the trace was made for.
    near_sizes: tuple[float, float] = (0.6, 1.6)
    # Parameters of the robot move at most by these factors in one linear step.
    nearby_factors: tuple[float, float] = (0.5, 2.0)
    # Averages over samples bring the rows to about this rate, Hz, faster than the robot can answer.
    table_rate: float = 25.0
    # Stretches of about this length, s, longer than the robot remembers, are taken as independent.
    stretch: float = 0.8

    # --- Partial regression
    # Directions weaker than this, in columns of unit length, are left alone.
    weak_column: float = 1e-6
    # Draws of signs by which p values are found.
    wild_draws: int = 999
    # Stretches that a test needs for each coefficient; with fewer its law is no longer Fisher's.
    clusters_each: int = 3

    # --- Which trials pass
    # Share of the squared free-run error that an effect must remove where it was not fitted.
    # Robots with real rollers and nothing hidden feign up to 4 %.
    least_gain: float = 0.06
    # Adjusted p value below which a gain counts as significant.
    significant: float = 0.05
    # What acts in a few moments only cannot be significant by the signs of many; removing this
    # share of the squared error where it was not fitted is evidence enough.
    overwhelming: float = 0.5
    # So is removing nearly all of it where it was fitted and this share elsewhere.
    nearly_all: float = 0.9
    some_elsewhere: float = 0.25
    # Times that were left out do not foretell what changes with time: where that removes this share
    # of the squared error that it is fitted to, the share counts as its gain.
    changing: float = 0.2
    # Estimates may miss a bound by this share of the typical size.
    bound_slack: float = 0.25
    # Where more than this share of the error that noise does not explain would be left, something
    # unknown prevails, and only effects of at least this share of their typical size are believed.
    prevailing: float = 0.5
    sizeable: float = 0.5
    # Refined are trials with at least this share of the best gain, and at most so many effects.
    worth_refining: float = 0.4
    most_refined: int = 5
    # Also refined are trials that explain this share of what the best explains where it is fitted.
    as_well: float = 0.85
    # Friction that stops a robot removes up to this many times more than its trace along a motion
    # that does not stop foretells (measured 2.3 on a robot that coasts in the model only).
    hope: float = 1.0 / 3.0
    # A trial of single wheels must gain this much more than one of all alike.
    split_gain: float = 0.02
    # A form that leaves less than this share of what another one leaves is the better one anyway.
    incomparably: float = 0.5
    # A pair must leave at most this share of what the best single effect leaves where it was not
    # fitted, and neither half may be able to do without the other.
    pair_clearly: float = 0.5
    # Forms of each effect that are paired, and pairs that are judged where they were not fitted.
    pair_forms: int = 2
    pairs_judged: int = 40
    # Squared error that one more coefficient must remove, as a share of what is left.
    price: float = 0.02

    # --- Refits
    # A rival with a chance above this to be as good as the best cannot be told from it.
    rival_chance: float = 0.05
    # Effects that make the drive late smooth the noise of its record, each in its own way.  That
    # feigns up to these shares of what they explain and of what they leave.
    late_feigned: tuple[float, float] = (0.3, 0.15)
    # Independent errors in a window, for Schwarz's criterion: they remember each other some tenths
    # of a second.
    errors_each_window: int = 8
    # Steps of a refinement: where an effect was added the start is close, where one was taken away
    # not. Two effects that start from where each was alone need few to be compared with other
    # pairs.
    refine_steps: int = 8
    refine_patient: int = 16
    refine_few: int = 3
    # What a step removes when it was the last one worth taking; less care suffices to compare
    # effects.
    refine_tolerance: float = 1e-5
    refine_rough: float = 1e-3
    refine_fine: float = 1e-6
    # Share of the squared error on its first part that another record's own values must remove.
    own_values_share: float = 0.02
    # Distance from a bound, in typical sizes, that is none.
    at_bound: float = 0.02
    # Values without a derivative: looks, and how close to come, as a share of the search range.
    looks: int = 9
    looks_close: float = 0.002

    # --- Dependences that no effect stands for
    # Frequencies of disturbances in time, Hz: from the slowest a log can show to those robots damp.
    slowest_tone: float = 0.05
    fastest_tone: float = 3.0
    tones: int = 24
    # Knots of a drift over the log, and of a map over the floor (by side).
    drift_knots: int = 6
    map_squares: int = 3
    # Wheel speed over which a dry force changes its sign, rad/s, and memories of it, s.
    dry_speed: float = 0.2
    dry_memories: tuple[float, float] = (0.1, 0.4)

    # --- A round of the search
    # A dependence that removes this share of the error while no effect passes, or that leaves less
    # than this share of what the best effect leaves, shows that something else is missing.
    dependence_gain: float = 0.15
    dependence_left: float = 0.6
    # Where the wheels agree with each other, effects that leave more than this share of an error
    # that is not noise (``UNEXPLAINED``) are not what is missing.
    remainder: float = 0.3
    # Squared error beyond that of noise, in units of the latter, that noise is no excuse for.
    clear_excess: float = 0.3
    # Chance below which the error of windows goes with how the robot moves in them.
    uneven_chance: float = 0.01

    # --- The search
    # Effects that a search adds at most, and its rounds.
    most_effects: int = 3
    most_rounds: int = 6
    # Times that all steps are chosen again; the second only where the first has changed one.
    passes: int = 2

    # --- Confirmation by forces
    # Blocks whose scatter makes the standard error.
    force_blocks: int = 20
    # Directions of the base weaker than this are left alone.
    force_weak: float = 1e-9
    # Below this share, by two standard errors, an effect is feigned: laws that the robot has reach
    # 0.7 to 1.2 beside others that are still missing, laws that only calm a simulation -0.1 to 0.1.
    denied_share: float = 0.5
    denied_errors: float = 2.0
    # Deviation of that share from 1, beside two standard errors, that speaks against a law: of 42
    # laws that simulated robots had at full size, two thirds of them with real rollers or lasting
    # noise, the farthest reached 0.93 and 1.04; laws that stood for another one 0.64 to 0.87 and
    # 1.3.
    off_share: float = 0.1
    # An axis along which the robot moves with less than this share of its speed, or of the log's
    # rms, is not judged then.  It stands there but for drift and for what the sensor sees of other
    # axes, and friction holds whatever it has to: rollers of a real robot had 0.1 +- 0.15 of a
    # friction in all rows and 1.1 +- 0.15 in those in which they turn.
    moving_share: float = 0.25

    # --- Errors on held-out windows
    # Draws of windows by which the interval of an error is found.
    holdout_draws: int = 2000
    # What noise that lasts leaves on a few windows scatters: on the part kept for the end of three
    # simulated records up to 1.9 times its floor, in squares.
    noise_scatter: float = 1.0
    # Of some makes of rollers the ripple of the library explains little; of those of which it is
    # the ripple, at least half of the squared error, or of the squared contradiction of the wheels
    # where something else makes the error (of 14 robots in MuJoCo 0.8 to 1).
    ripple_explained: float = 0.5
    # An error of this share is that of a model that says nothing: the mean of the motion, or no
    # force.
    whole_error: float = 1.0

    # --- Other records
    # Share of the squared error of another record, beside effects that the search has yet to find,
    # that a slope of 0.7 degrees there removes where it was not fitted; a few windows allow no
    # less.
    different_record: float = 0.3

    # --- What the log would have shown
    # Power at which a size counts as detectable.
    power: float = 0.8

    # --- The experiment that would decide
    # Rate of the simulated records, Hz.
    experiment_rate: float = 50.0
    # Errors of a free run remember each other over about this time, s: so long is one observation.
    error_memory: float = 0.3
    # Odds beyond this are as good as certain.
    certain_odds: float = 1e6
    # Length of an experiment, s.
    experiment_seconds: float = 60.0

    # --- What is told
    # Beside an effect that is named, this share of the error that it should explain is worth a
    # word.
    worth_telling: float = 0.1
    # Motions across equal strokes that a reason mentions.
    strokes_told: int = 2


SETTINGS = Settings()
