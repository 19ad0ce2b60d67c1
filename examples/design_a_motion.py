"""Design a motion that tells the mass best, drive it, and identify from the log."""

from pathlib import Path

from ident import Log, design_motion, identify
from youbot_env.model_file import load_model
from youbot_env.recording import record_motion, write_table
from youbot_env.simulation import AnalyticPlant, Sensors

Path("runs").mkdir(exist_ok=True)
# Fewer harmonics and starts than usual: seconds instead of a minute.
design = design_motion("m0", "paper", seconds=40.0, harmonics=3, starts=2, seed=0)
print(design)
design.plot().savefig("runs/design_a_motion.png")

plant = AnalyticPlant(load_model("paper"), 0.01)
rows = record_motion(plant, design.motion, 40.0, sensors=Sensors(), seed=0)
write_table(Path("runs/designed.csv"), rows, ["motion designed for m0"])

mass = identify(Log.load("runs/designed.csv"), "nominal").parameters["m0"]
low, high = mass.ci95
print(f"m0 = {mass.value:.2f} kg, 95 % interval {low:.2f} to {high:.2f} kg")
print(f"expected half width {design.expected()['m0']:.2f} kg, got {(high - low) / 2:.2f} kg")
