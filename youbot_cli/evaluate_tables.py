"""Tables of a comparison of controllers: for programs, for the terminal and for the page."""

from __future__ import annotations

from typing import Any

from controllers import find
from controllers.evaluation.claims import Claim
from controllers.evaluation.motions import REFERENCES
from controllers.evaluation.plan import MAIN
from controllers.evaluation.results import ERRORS, Results
from controllers.evaluation.statistics import Figure
from controllers.evaluation.subjects import MODELS
from controllers.evaluation.tornado import Cost
from youbot_cli import console

PLAIN = ("effort", "saturation", "solve_median", "solve_p99", "fallbacks", "lost")
SHOWN = 8


def error_rows(results: Results) -> list[dict]:
    """Every error, effort and time, one row for a controller, model and motion."""
    keys, rows = ["plant", "controller", "model", "reference", "frequency"], []
    for values in results.table.select(keys).unique(maintain_order=True).iter_rows(named=True):
        row: dict[str, Any] = dict(values)
        row |= {metric: results.mean(metric, **values).as_dict() for metric in ERRORS}
        row |= {name: float(results.robots(name, **values).mean()) for name in PLAIN}
        rows.append(rounded(row))
    return rows


def rounded(value: Any) -> Any:
    """Numbers to four digits, which is more than their intervals leave."""
    if isinstance(value, dict):
        return {key: rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [rounded(item) for item in value]
    return float(f"{value:.4g}") if isinstance(value, float) else value


def gap_rows(results: Results) -> list[dict]:
    """Share of the gap closed, by plant, controller, reference, frequency and model."""
    keys, rows = ["plant", "controller", "reference", "frequency"], []
    for values in results.table.select(keys).unique(maintain_order=True).iter_rows(named=True):
        for model in MODELS[1:-1]:
            figure = results.gap_closed("position", model=model, **values)
            if figure.robots:
                rows.append(rounded({**values, "model": model} | figure.as_dict()))
    return rows


def errors_by_frequency(
    results: Results, plant: str, metric: str, scale: float, reference: str
) -> tuple[tuple[str, ...], list[tuple]]:
    """Head and rows of a table of one error: controllers and models down, rad/s across."""
    which = {"plant": plant, "reference": reference}
    frequencies = [
        w for w in results.of("frequency") if len(results.robots(metric, frequency=w, **which))
    ]
    rows = []
    for controller in in_order(results):
        for model in MODELS:
            one = which | {"controller": controller, "model": model}
            cells = [results.robots(metric, frequency=w, **one) for w in frequencies]
            if any(len(cell) for cell in cells):
                means = (f"{scale * cell.mean():.2f}" if len(cell) else "" for cell in cells)
                rows.append((named(controller, model), *means))
    return ("rad/s", *(f"{w:g}" for w in frequencies)), rows


def named(controller: str, model: str) -> str:
    """Controller and what it believes, in words; the model only where it matters."""
    words = controller.replace("_", " ")
    return f"{words}, {model}" if find(controller).uses_model else words


def in_order(results: Results) -> list[str]:
    """Controllers that were run, those of the paper's comparison first."""
    rank = {name: number for number, name in enumerate(MAIN)}
    return sorted(results.of("controller"), key=lambda name: (rank.get(name, len(MAIN)), name))


def first_reference(results: Results, plant: str) -> str:
    """The reference shown first: the first of the list that was run on a plant."""
    run = results.table.filter(results.table["plant"] == plant)["reference"].to_list()
    return next(name for name in REFERENCES if name in run)


def claim_rows(checked: list[Claim]) -> list[tuple[str, ...]]:
    """Plant, claim, figure, interval, target, verdict, worst motion."""
    return [
        (
            claim.plant,
            claim.text,
            f"{claim.figure.value:.3g} {claim.unit}".strip(),
            interval(claim.figure),
            claim.target,
            "met" if claim.met else "missed",
            claim.where,
        )
        for claim in checked
    ]


def interval(figure: Figure, scale: float = 1.0) -> str:
    """Ends of a 95 % interval; a dash where there is none."""
    if figure.low != figure.low:
        return "-"
    return f"{scale * figure.low:.3g} ... {scale * figure.high:.3g}"


def tell(
    results: Results, checked: list[Claim], costs: list[Cost], skipped: dict[str, str]
) -> None:
    """Print the verdict, the claims, the errors over frequency and the dearest wrong beliefs."""
    met = sum(claim.met for claim in checked)
    console.out.print(f"{met} of {len(checked)} targets are met\n")
    for plant, text, figure, around, target, verdict, where in claim_rows(checked):
        known = "" if around == "-" else f" ({around})"
        worst = f"; worst at {where} rad/s" if where else ""
        line = f"{verdict:7} {figure}{known}, {target}: {plant}, {text}{worst}"
        console.out.print(line, soft_wrap=True)
    for plant in results.of("plant"):
        reference = first_reference(results, plant)
        for metric, unit in (("position", "mm"), ("velocity", "mm/s")):
            heads, rows = errors_by_frequency(results, plant, metric, 1e3, reference)
            title = f"\nRms {metric} error, {unit}, {plant} plant, {reference}"
            console.table(title, heads, rows)
    if costs:
        dear = [
            (c.name, c.kind, f"+{1e3 * c.added.value:.2f}", interval(c.added, 1e3))
            for c in costs[:SHOWN]
        ]
        heads = ("wrong about", "by", "adds mm", "95 % interval")
        console.table("\nWhat costs the most tracking error", heads, dear)
    for name, reason in skipped.items():
        console.err.print(f"{name} was left out: {reason}", style="yellow", soft_wrap=True)
