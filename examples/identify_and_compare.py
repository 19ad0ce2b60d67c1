"""Identify the bundled robot, then see on another log how much better that model predicts."""

from pathlib import Path

from ident import compare, identify
from youbot_env.model_file import save_model

found = identify("youbot_fit", "nominal", test="youbot_test")
print(found)  # parameters with 95 % intervals

Path("runs").mkdir(exist_ok=True)
save_model(found.model, "runs/robot.yaml")

# Free runs: velocities simulated from the torques of the log alone, in windows of 5 s.
rivals = compare("youbot_test", ["nominal", "runs/robot.yaml"])
print(rivals)
nominal, identified = (one.run.nrmse for one in rivals)
print(f"free-run error: {100 * nominal:.0f} % nominal, {100 * identified:.0f} % identified")
rivals.plot().savefig("runs/identify_and_compare.png")
