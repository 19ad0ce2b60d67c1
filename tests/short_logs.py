"""Two short logs of a robot that hides an effect, for tests of the loop."""

from pathlib import Path

from youbot_env.model_file import load_model
from youbot_env.recording import record_motion, write_table
from youbot_env.references import calibration_sequence, make_reference
from youbot_env.simulation import AnalyticPlant, Sensors, WheelLoop

HIDDEN = 0.25  # N m of dry friction on each wheel


def record_two(folder: Path) -> list[Path]:
    """Write a log to fit, of the calibration motions, and one of another motion to judge by."""
    robot = load_model("paper").with_effects({"wheel_coulomb_friction": HIDDEN})
    files = []
    for seed, motion, seconds in (
        (1, calibration_sequence(seconds=36.0), 40.0),
        (2, make_reference("smooth_random"), 24.0),
    ):
        plant, loop = AnalyticPlant(robot, 0.02), WheelLoop()
        columns = record_motion(plant, motion, seconds, loop, Sensors(), seed, loop_rate=1000.0)
        files.append(write_table(folder / f"log{seed}.csv", columns, decimals=4))
    return files
