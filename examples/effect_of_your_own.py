"""State a physical effect, hide it in a robot, and identify its size from a log."""

from pathlib import Path

from ident import Log, identify
from youbot_env.effects import Effect, Parameter, register
from youbot_env.model_file import load_model
from youbot_env.recording import record_motion, write_table
from youbot_env.references import make_reference
from youbot_env.simulation import AnalyticPlant, Sensors


@register
class TurningDrag(Effect):
    """Moment against turning in proportion to speed and yaw rate."""

    identifier = "turning_drag"
    title = "Drag against turning at speed"
    equation = r"M_\Omega = -c\,\lVert V\rVert\,\Omega"
    link = "body"
    parameters = (Parameter("c", "N s^2", "drag coefficient", 20.0, (0.0, 500.0)),)

    def body(self, p, s, ops):
        """Wrench on the body, N, N, N m."""
        vx, vy, om = s.v
        return 0.0, 0.0, -p.c * ops.sqrt(vx * vx + vy * vy + 1e-6) * om


Path("runs").mkdir(exist_ok=True)
plant = AnalyticPlant(load_model("paper").with_effects({"turning_drag": {"c": 40.0}}), 0.01)
motion = make_reference("calibration", seconds=60.0)
write_table(Path("runs/drag.csv"), record_motion(plant, motion, 60.0, sensors=Sensors(), seed=0))
found = identify(Log.load("runs/drag.csv"), "nominal", add=("turning_drag",))
print(found)
