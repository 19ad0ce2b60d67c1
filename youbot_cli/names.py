"""Names and numbers that the help texts tell, written out here: their homes take a while to import.

Each stands beside its home; ``tests/test_start_up.py`` holds them against it.
"""

# youbot_env.references.REFERENCES and the motions shipped in youbot_env.references.MOTIONS.
MOTIONS = (
    "circle", "eight", "multisine", "step", "smooth_random", "joystick", "square", "I", "II",
    "III", "IV", "calibration", "I1", "all", "chirp", "fast", "fast_reversals", "four_headings",
    "m0", "single_wheel", "slow_ramps", "spin",
)  # fmt: skip
# youbot_env.simulation.ROWS, and what youbot record adds.
HOLDS = ("sampled", "averaged", "held")
# youbot_env.platform_file.LINE
PLATFORM_LINE = "R=0.05 r=0.015 l=0.15 h=0.2"
# controllers.evaluation.motions.REFERENCES
FOLLOWED = ("eight", "circle", "multisine", "step")
# controllers.training.trial.FIRST_SEED
FIRST_SEED = 1_000_000
# ident.benchmark.cases.PARTS
PARTS = ("nothing", "single", "outside", "laws", "pairs", "rollers")
# Defaults of ident.design.Limits: rad/s, m/s^2, rad/s^2, N m.
YAW_RATE, ACCELERATION, YAW_ACCELERATION, TORQUE = 1.0, 1.0, 2.5, 3.0
