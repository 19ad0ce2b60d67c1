"""Identify one robot from many short logs, judge it on each, and tabulate the errors."""

from pathlib import Path

import polars

from ident import compare, identify
from youbot_env.model_file import load_model, save_model
from youbot_env.recording import record_motion, write_table
from youbot_env.references import make_reference
from youbot_env.simulation import AnalyticPlant, Sensors

Path("runs").mkdir(exist_ok=True)
motion = make_reference("smooth_random")
for number in range(5):  # short runs of one robot, each another motion
    plant = AnalyticPlant(load_model("paper"), 0.01)
    rows = record_motion(plant, motion, 12.0, sensors=Sensors(), seed=number)
    write_table(Path(f"runs/run{number}.csv"), rows)

files = sorted(Path("runs").glob("run*.csv"))
found = identify(files[:4], "nominal", test=files[4])
save_model(found.model, "runs/batch.yaml")
print(found)

errors = {"log": [], "nominal": [], "identified": []}
for file in files:
    nominal, identified = compare(file, ["nominal", "runs/batch.yaml"])
    errors["log"].append(file.name)
    errors["nominal"].append(nominal.run.nrmse)
    errors["identified"].append(identified.run.nrmse)
print(polars.DataFrame(errors))
