"""Predictive control as a real-time program: time, failures, and nearness to the exact solution."""

from __future__ import annotations

import itertools
import time
from collections import Counter
from collections.abc import Callable

import numpy as np

from controllers import make
from controllers.evaluation.motions import Motion
from controllers.evaluation.run import drive, make_env, measure
from controllers.evaluation.subjects import NOMINAL, ORACLE, Subject
from controllers.mpc import MPC
from youbot_env.simulation import Sensors

# Calm and quick motions in turn; the last asks for more than the torque limit most of the time.
MOTIONS = (Motion("eight", 1.0), Motion("multisine", 2.0), Motion("eight", 4.0, 0.5))
LIMIT, EPISODE = 3.0, 1000
# The exact solution takes fifty times as long, so it follows a shorter part.
EXACT_MOTIONS = (Motion("eight", 1.0, length=2.0), Motion("eight", 3.0, 0.4, length=2.0))


def endurance(
    subject: Subject, steps: int, show: Callable[[int], None] = lambda done: None
) -> dict:
    """Drive under sensor noise, drive delay and torque limits, and look at every single answer.

    A failure is reported when the controller counted it (``MPC.counts``) and a safe law took over.
    It is unreported when an action is not finite or beyond the limit, or when a period left no
    record.

    Args:
        subject: its truth has the delay.
        steps: control periods.
        show: called with the periods done.

    Returns:
        Counts by status, times in seconds (wall, and of the thread on its core), failures.
    """
    controller: MPC = make("mpc", subject.model(ORACLE), torque_limit=LIMIT)
    env = make_env(subject, controller, Sensors())
    episodes, motions = np.random.SeedSequence(subject.seed), itertools.cycle(MOTIONS)
    cpu, broken, limited, saturated, seen, state = [], 0, 0, 0, None, None
    for step in range(steps):
        start = seen is None
        if start:
            seed = int(episodes.spawn(1)[0].generate_state(1)[0])
            seen, _ = env.reset(seed=seed, options={"reference": next(motions).reference})
        recorded, began = len(controller.solves), time.thread_time()
        action, state = controller.predict(seen, state, np.array([start]))
        cpu.append(time.thread_time() - began)
        broken += not (np.isfinite(action).all() and np.abs(action).max() <= 1.0)
        broken += len(controller.solves) != recorded + 1
        limited += controller.solves[-1].status == "solved at a limit"
        seen, _, lost, _, info = env.step(action)
        saturated += np.abs(info["torque"]).max() >= 0.999 * LIMIT
        if lost or (step + 1) % EPISODE == 0:
            seen = None
        show(step + 1)
    env.close()
    wall = np.array([solve.seconds for solve in controller.solves])
    return {
        "steps": steps,
        "statuses": dict(Counter(solve.status for solve in controller.solves)),
        "reported_failures": controller.counts["fallback"],
        "unreported_failures": int(broken),
        "share_at_limit": float(saturated / steps),
        "share_solved_at_limit": limited / steps,
        "solve_wall": _times(wall),
        "solve_cpu": _times(np.array(cpu)),
        "horizon": controller.settings.preview,
        "states": 6,
        "torques": len(subject.truth.platform.wheels),
        "solver": controller.settings.solver,
    }


def against_exact(subject: Subject, motion: Motion) -> dict:
    """Closed-loop error of the fast solver and of IPOPT on the same run.

    The model believed is the nominal one, so that there is something to correct.

    Returns:
        Rms position errors, m, median times of a solve, s, fallbacks, and ``apart``: by which share
        of the error of IPOPT the fast solver's differs.
    """
    result: dict = {"reference": motion.name, "frequency": motion.frequency, "speed": motion.speed}
    for solver in ("rti", "ipopt"):
        controller: MPC = make("mpc", subject.model(NOMINAL), solver=solver, torque_limit=LIMIT)
        env = make_env(subject, controller, Sensors())
        trace = drive(controller, env, motion, subject.seed)
        env.close()
        result[solver] = {
            "position": measure(trace, controller.settings.dt, LIMIT, motion.speed)["position"],
            "solve_median": float(np.median([solve.seconds for solve in controller.solves])),
            "fallbacks": controller.counts["fallback"],
        }
    apart = abs(result["rti"]["position"] / result["ipopt"]["position"] - 1.0)
    return result | {"apart": apart}


def _times(seconds: np.ndarray) -> dict[str, float]:
    median, p99 = np.percentile(seconds, (50, 99))
    return {"median": float(median), "p99": float(p99), "worst": float(seconds.max())}
