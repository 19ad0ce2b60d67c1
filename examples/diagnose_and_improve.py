"""Hide an effect in a simulated robot, find it in the logs and improve the model."""

from pathlib import Path

from ident import Log, improve
from youbot_env.model_file import load_model, save_model
from youbot_env.recording import record_motion, write_table
from youbot_env.references import make_reference
from youbot_env.simulation import AnalyticPlant, Sensors

Path("runs").mkdir(exist_ok=True)
robot = load_model("paper").with_effects({"quadratic_drag": {"c": 60.0}})
for number, motion in enumerate(("calibration", "smooth_random")):
    plant, seconds = AnalyticPlant(robot, 0.01), 48.0
    options = {"seconds": seconds} if motion == "calibration" else {}
    rows = record_motion(
        plant, make_reference(motion, **options), seconds, sensors=Sensors(), seed=number
    )
    write_table(Path(f"runs/{motion}.csv"), rows, ["quadratic drag is hidden here"])

log, other = Log.load("runs/calibration.csv"), Log.load("runs/smooth_random.csv")
# `diagnose` alone would only say what is missing; `improve` adds it and refits as well.
better = improve(log, "nominal", test=other)
print(better.found)  # the diagnosis
print(better)
save_model(better.model, "runs/improved.yaml")
for active in better.model.effects:
    print(f"found: {active.identifier} {active.values}, hidden: c = 60")
