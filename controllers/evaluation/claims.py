"""What the comparison should show, checked on its results: figure, interval, target, met or not."""

from __future__ import annotations

import math
from dataclasses import dataclass

from controllers.evaluation.results import Results
from controllers.evaluation.statistics import Figure, mean
from controllers.evaluation.subjects import IDENTIFIED, INFORMED

# Steps ask for more than any drive can do; they are measured but nothing is claimed of them.
SMOOTH = ("eight", "circle", "multisine")
# The paper: kinematic control is not accurate enough above this, rad/s.
PAPER_LIMIT, FASTEST = 0.5, 3.0
KINEMATIC, DYNAMIC = "kinematic", ("computed_torque", "mpc")
TIMES_BELOW = {"analytic": 5.0, "rollers": 2.0}
GAP = 0.8
SLOW_POSITION, SLOW_HEADING = 0.010, math.radians(1.0)
MEDIAN, P99, APART = 1e-3, 3e-3, 0.05


@dataclass(frozen=True)
class Claim:
    """One thing that the comparison should show.

    Attributes:
        plant: where.
        text: what.
        figure: what was measured.
        target: what it should be, in words.
        met: whether the figure reaches it.
        unit: of the figure; empty for a ratio.
        where: the motion (reference, rad/s) at which the figure is worst; empty for all of them.
    """

    plant: str
    text: str
    figure: Figure
    target: str
    met: bool
    unit: str = ""
    where: str = ""

    def as_dict(self) -> dict:
        """Return what JSON shows."""
        words = {"plant": self.plant, "claim": self.text, "where": self.where}
        verdict = {"unit": self.unit, "target": self.target, "met": self.met}
        return words | self.figure.as_dict() | verdict


def claims(results: Results) -> list[Claim]:
    """All claims that the runs at hand can answer."""
    found = []
    for plant in results.of("plant"):
        found += [*growth(results, plant), *times_below(results, plant), *gaps(results, plant)]
        if plant == "rollers":
            found += slow_and_small(results)
    return found


def growth(results: Results, plant: str) -> list[Claim]:
    """The error of the kinematic controller grows above the frequency that the paper names."""
    found, which = [], {"plant": plant, "controller": KINEMATIC}
    for metric in ("position", "velocity"):
        worst = None
        for reference in _smooth(results, which):
            there = which | {"reference": reference}
            frequencies = _frequencies(results, there)
            if PAPER_LIMIT not in frequencies or len(frequencies) < 2:
                continue
            slow, fast = {"frequency": PAPER_LIMIT}, {"frequency": frequencies[-1]}
            figure = results.ratio(metric, fast, slow, **there)
            if worst is None or figure.value < worst[0].value:
                worst = figure, f"{reference}, {frequencies[-1]:g}"
        if worst:
            text = f"{KINEMATIC}: {metric} error grows above {PAPER_LIMIT:g} rad/s"
            met = worst[0].value > 1 and not worst[0].low <= 1
            found.append(Claim(plant, text, worst[0], "> 1", met, "times", worst[1]))
    return found


def times_below(results: Results, plant: str) -> list[Claim]:
    """Dynamic control stays below the kinematic error at every smooth motion."""
    found, target = [], TIMES_BELOW[plant]
    for controller in DYNAMIC:
        for model in (INFORMED, IDENTIFIED):
            for metric in ("position", "velocity"):
                which = {"plant": plant, "controller": controller, "model": model}
                ratios = {}
                for reference in _smooth(results, which):
                    there = {"plant": plant, "reference": reference}
                    for w in _frequencies(results, which | there):
                        one = {"controller": controller, "model": model}
                        ratios[f"{reference}, {w:g}"] = results.ratio(
                            metric, {"controller": KINEMATIC}, one, frequency=w, **there
                        )
                ratios = {k: v for k, v in ratios.items() if not math.isnan(v.value)}
                if not ratios:
                    continue
                where = min(ratios, key=lambda name: ratios[name].value)
                text = f"{controller}, {model}: {metric} below kinematic"
                met = ratios[where].value >= target
                words = f">= {target:g}"
                found.append(Claim(plant, text, ratios[where], words, met, "times", where))
    return found


def gaps(results: Results, plant: str) -> list[Claim]:
    """An identified model closes the gap between the nominal and the true one."""
    found = []
    for controller in DYNAMIC:
        for model in (INFORMED, IDENTIFIED):
            which = {"plant": plant, "controller": controller}
            references = _smooth(results, which | {"model": model})
            if not references:
                continue
            frequencies = _frequencies(results, which | {"reference": references})
            figure = results.gap_closed(
                "position", model=model, reference=references, frequency=frequencies, **which
            )
            if math.isnan(figure.value):
                continue
            text = f"{controller}, {model}: gap to the oracle closed"
            found.append(Claim(plant, text, figure, f">= {GAP:g}", figure.value >= GAP))
    return found


def slow_and_small(results: Results) -> list[Claim]:
    """Circle and eight at 0.3 m/s and 0.5 rad/s on real rollers, in millimetres and degrees."""
    found = []
    for controller in DYNAMIC:
        for reference in ("circle", "eight"):
            which = {"plant": "rollers", "controller": controller, "model": INFORMED}
            which |= {"reference": reference, "frequency": PAPER_LIMIT}
            position, heading = (results.robots(m, **which) for m in ("position", "heading"))
            if not len(position):
                continue
            text = f"{controller}, {INFORMED}, {reference} at 0.3 m/s"
            limit = f"< {1e3 * SLOW_POSITION:g} on each robot"
            met = bool(position.max() < SLOW_POSITION)
            found.append(Claim("rollers", f"{text}: position", mean(1e3 * position), limit, met,
                               "mm"))  # fmt: skip
            degrees, met = [math.degrees(v) for v in heading], bool(heading.max() < SLOW_HEADING)
            found.append(Claim("rollers", f"{text}: heading", mean(degrees),
                               "< 1 on each robot", met, "deg"))  # fmt: skip
    return found


def solver_claims(endurance: dict, exact: list[dict]) -> list[Claim]:
    """What predictive control should show as a program."""
    steps, size = endurance["steps"], endurance
    problem = f"mpc, {size['states']} states, {size['torques']} torques, N = {size['horizon']}"

    def claim(text: str, value: float, target: str, met: bool, unit: str) -> Claim:
        return Claim("analytic", text, Figure(value, math.nan, math.nan, 1), target, met, unit)

    times = endurance["solve_cpu"]
    apart = max(run["apart"] for run in exact)
    return [
        claim(f"{problem}: median solve, core time", 1e3 * times["median"], "<= 1",
              times["median"] <= MEDIAN, "ms"),
        claim(f"{problem}: p99 solve, core time", 1e3 * times["p99"], "<= 3",
              times["p99"] <= P99, "ms"),
        claim(f"mpc: unreported failures in {steps} steps", endurance["unreported_failures"],
              "none", endurance["unreported_failures"] == 0, ""),
        claim("mpc: closed-loop error apart from IPOPT's", 100 * apart, "<= 5",
              apart <= APART, "%"),
    ]  # fmt: skip


def _smooth(results: Results, which: dict) -> list[str]:
    """Smooth references of which there are runs."""
    return [name for name in SMOOTH if len(results.robots("position", reference=name, **which))]


def _frequencies(results: Results, which: dict) -> list[float]:
    """Frequencies of the claims at which there are runs."""
    between = [w for w in results.of("frequency") if PAPER_LIMIT <= w <= FASTEST]
    return [w for w in between if len(results.robots("position", frequency=w, **which))]
