"""The page of a comparison of controllers."""

from __future__ import annotations

import base64

from controllers.evaluation.claims import KINEMATIC, PAPER_LIMIT, Claim
from controllers.evaluation.results import Results
from controllers.evaluation.subjects import INFORMED, MODELS, NOMINAL, Subject
from controllers.evaluation.tornado import Cost
from ident.report.page import Grid, Live, Notes, Page, Picture, Section
from youbot_cli.evaluate_figures import film, frequency_figure, references_figure, tornado_figure
from youbot_cli.evaluate_tables import (
    claim_rows,
    errors_by_frequency,
    first_reference,
    gap_rows,
    in_order,
    named,
)

GAP_OF = "computed_torque"
RIVALS = ((KINEMATIC, NOMINAL), ("computed_torque", INFORMED))
WORDS = {
    "analytic": "the plant that follows the equations with hidden effects",
    "rollers": "the plant with real rollers",
}


def evaluation_page(
    results: Results,
    checked: list[Claim],
    costs: list[Cost],
    solver: dict | None,
    subjects: dict[str, list[Subject]],
    used: dict,
    history: dict[str, str],
) -> tuple[Page, dict[str, bytes]]:
    """Draw everything and put the page together; nothing is written.

    Returns:
        The page, and its films by file name.
    """
    films = {
        f"{plant}.gif": film(robots[0], RIVALS)
        for plant, robots in subjects.items()
        if {name for name, _ in RIVALS} <= set(results.of("controller"))
    }
    missed = [claim for claim in checked if not claim.met]
    hidden = ", ".join(f"{k.replace('_', ' ')} {v:g}" for k, v in used["hidden"].items())
    counted = " and ".join(f"{n} on the {plant} plant" for plant, n in used["robots"].items())
    lead = (
        f"Robots drawn around the paper's values: {counted}. Hidden in each, within 15 %: "
        f"{hidden}. Each recorded one calibration log and was identified from it; every "
        "controller then followed the same references under the same noise. Intervals are 95 %, "
        "bootstrapped over paired robots."
    )
    sections = [
        targets(checked),
        over_frequency(results),
        Section("Films", [_film(name, data) for name, data in films.items()]) if films else None,
        wrong_beliefs(costs) if costs else None,
        gap(results) if GAP_OF in results.of("controller") else None,
        *(tables(results, plant) for plant in results.of("plant")),
        program(solver) if solver else None,
    ]
    page = Page(
        title="Controllers and what they believe",
        verdict=verdict(checked),
        good=not missed,
        lead=lead,
        figures=headline(checked),
        sections=[section for section in sections if section],
        provenance=history,
    )
    return page, films


def verdict(checked: list[Claim]) -> str:
    """The answer in one sentence."""
    met = sum(claim.met for claim in checked)
    return (
        f"What was identified pays off in tracking: {met} of {len(checked)} targets are met"
        if met == len(checked)
        else f"{met} of {len(checked)} targets are met; the missed ones stand below"
    )


def headline(checked: list[Claim]) -> list[tuple[str, str]]:
    """The few figures that carry the page."""
    found = []
    for claim in checked:
        if "computed_torque, identified + effects: position below" in claim.text:
            words = f"times below the kinematic error, at worst, {claim.plant}"
            found.append((f"{claim.figure.value:.1f}", words))
        if "computed_torque, identified + effects: gap" in claim.text:
            words = f"of the gap nominal to oracle closed, {claim.plant}"
            found.append((f"{100 * claim.figure.value:.0f} %", words))
    return found


def targets(checked: list[Claim]) -> Section:
    """Every claim with its figure, interval and target."""
    note = (
        "The figure is that of the worst motion among eight, circle and multisine at 0.5 to 3 "
        "rad/s where one is named. Identified: the seven parameters of the equations. Identified + "
        "effects: told which effects to look for, it found their sizes."
    )
    plants = list(dict.fromkeys(claim.plant for claim in checked))
    grids = []
    for plant in plants:
        rows = [row[1:] for row in claim_rows([c for c in checked if c.plant == plant])]
        head = (f"{plant} plant", "figure", "95 % interval", "target", "", "worst, rad/s")
        grids.append(Grid(head, rows, note if plant == plants[-1] else "", words=(0, 3, 4, 5)))
    return Section("Targets", grids)


def over_frequency(results: Results) -> Section:
    """The figure of the paper, and its continuation."""
    first = first_reference(results, results.of("plant")[0])
    caption = (
        f"Rms errors on the {first} at 0.3 m/s. Dotted: {PAPER_LIMIT:g} rad/s, above which the "
        "paper calls kinematic control unsatisfactory. Solid: computed torque; dashed: predictive "
        "control. Bands: 95 % intervals over robots."
    )
    blocks = [Picture("error_over_frequency", frequency_figure(results, first), caption)]
    if len(results.of("reference")) > 1:
        caption = (
            "The same for every reference. Steps of the velocity ask for more than any drive can "
            "do: there the controllers differ by how they come back (at 0.1 rad/s no step falls "
            "into the measured time)."
        )
        blocks.append(Picture("references", references_figure(results), caption))
    return Section("Error over frequency", blocks)


def wrong_beliefs(costs: list[Cost]) -> Section:
    """The tornado."""
    caption = (
        "Computed torque with the true model but for one thing, on eight (1 rad/s) and circle "
        "(2 rad/s), without its observer of disturbances. A parameter is off by 20 %, or by the "
        "half width of its identified 95 % interval (the worse sign); an effect is left out. "
        "Measured at the wheels, so that position and heading count."
    )
    picture = Picture("wrong_beliefs", tornado_figure(costs), caption)
    lead = "What is worth identifying next: which wrong number or missing effect costs the most."
    return Section("What a wrong belief costs", [picture], lead)


def gap(results: Results) -> Section:
    """Share of the gap closed, motion by motion."""
    cells: dict[tuple, dict[float, str]] = {}
    for r in gap_rows(results):
        if r["controller"] == GAP_OF:
            low, high = r["ci95"]
            words = f"{100 * r['value']:.0f}"
            words += "" if low != low else f" ({100 * low:.0f} ... {100 * high:.0f})"
            place = (f"{r['plant']}, {r['reference']}", r["model"])
            cells.setdefault(place, {})[r["frequency"]] = words
    frequencies = sorted({w for row in cells.values() for w in row})
    rows = [(*place, *(row.get(w, "") for w in frequencies)) for place, row in cells.items()]
    head = ("rad/s", "", *(f"{w:g}" for w in frequencies))
    note = (
        "Computed torque: (nominal - identified) / (nominal - oracle) of the rms position error, "
        "per cent, with 95 % intervals. On real rollers the oracle has the true masses and "
        "effects, and still no equation for contacts."
    )
    return Section("Share of the gap closed", [Grid(head, rows, note, words=(0, 1))])


def tables(results: Results, plant: str) -> Section:
    """Position and velocity errors, then effort and times, on one plant."""
    blocks = []
    run = results.table.filter(results.table["plant"] == plant)["reference"].unique().sort()
    for reference in run.to_list():
        for metric, unit in (("position", "mm"), ("velocity", "mm/s")):
            head, rows = errors_by_frequency(results, plant, metric, 1e3, reference)
            note = f"{reference}: rms {metric} error, {unit}, over the frequency of the motion."
            blocks.append(Grid(head, rows, note))
    rows = []
    for controller in in_order(results):
        for model in MODELS:
            one = {"plant": plant, "controller": controller, "model": model}
            if not len(results.robots("effort", **one)):
                continue
            mean = {
                name: float(results.robots(name, **one).mean())
                for name in ("effort", "saturation", "solve_median", "solve_p99", "fallbacks",
                             "lost")
            }  # fmt: skip
            rows.append(
                (named(controller, model), f"{mean['effort']:.2f}",
                 f"{100 * mean['saturation']:.2f}", f"{1e3 * mean['solve_median']:.3f}",
                 f"{1e3 * mean['solve_p99']:.3f}", f"{mean['fallbacks']:.2g}",
                 f"{100 * mean['lost']:.2g}")
            )  # fmt: skip
    head = ("controller, model", "torque N m", "saturated %", "median ms", "p99 ms",
            "fallbacks a run", "lost %")  # fmt: skip
    note = "Rms torque of a wheel; wheels at the limit; time of one decision on its core."
    blocks.append(Grid(head, rows, note))
    return Section(f"All errors on {WORDS[plant]}", blocks)


def program(solver: dict) -> Section:
    """Predictive control as a real-time program."""
    run, times = solver["endurance"], solver["endurance"]["solve_cpu"]
    wall = run["solve_wall"]
    sentences = [
        f"{run['steps']} control periods under sensor noise, drive delay and a torque limit that "
        f"is reached in {100 * run['share_at_limit']:.0f} % of them; horizon of "
        f"{run['horizon']} steps.",
        f"One decision takes {1e3 * times['median']:.2f} ms (median), {1e3 * times['p99']:.2f} ms "
        f"(p99), {1e3 * times['worst']:.2f} ms (worst) of its core; on the clock of this machine "
        f"with all that ran beside it {1e3 * wall['median']:.2f}, {1e3 * wall['p99']:.2f} and "
        f"{1e3 * wall['worst']:.2f} ms.",
        f"Answers: {', '.join(f'{k} {v}' for k, v in run['statuses'].items())}. "
        f"{run['reported_failures']} were not used and counted, computed torque took over; "
        f"{run['unreported_failures']} failed without being counted.",
    ]
    sentences += [
        f"Beside IPOPT on {e['reference']}, {e['frequency']:g} rad/s, {e['speed']:g} m/s: "
        f"{1e3 * e['rti']['position']:.3f} and {1e3 * e['ipopt']['position']:.3f} mm, "
        f"{100 * e['apart']:.2g} % apart; {1e3 * e['rti']['solve_median']:.2f} and "
        f"{1e3 * e['ipopt']['solve_median']:.1f} ms a solve."
        for e in solver["against_exact"]
    ]
    return Section("Predictive control as a program", [Notes(sentences)])


def _film(name: str, data: bytes) -> Live:
    source = "data:image/gif;base64," + base64.b64encode(data).decode("ascii")
    plant = name.partition(".")[0]
    caption = (
        f"The eight at 0.3 m/s and 1 rad/s on {WORDS[plant]}: kinematic (left) and computed torque "
        "with the identified model and effects (right)."
    )
    return Live(f"film_{plant}", f'<img src="{source}" alt="{caption}">', caption)
