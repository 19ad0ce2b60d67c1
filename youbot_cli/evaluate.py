"""Compare controllers with what they believe about a robot: who tracks how well, and why."""

from __future__ import annotations

import os
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from youbot_cli import console, effect_options
from youbot_cli.names import FOLLOWED
from youbot_cli.parallel import Parallel, Piece
from youbot_cli.pieces import Pieces, digest, place

if TYPE_CHECKING:
    from controllers.evaluation import tornado
    from controllers.evaluation.plan import Block
    from controllers.evaluation.run import Run
    from controllers.evaluation.subjects import Subject
    from youbot_env.model import Model
    from youbot_env.simulation import Sensors

# What is hidden in every robot, in the middle of the population.
HIDDEN = {"wheel_coulomb_friction": 0.2, "yaw_scrub_friction": 2.0, "actuator_delay": 0.015}
# The tornado asks of that many robots; the lengths of the calibration logs, s.
TORNADO_ROBOTS, LOG_SECONDS = 4, 56.0


def evaluate(
    controller: Annotated[
        list[str] | None, typer.Option(help="Name; several may follow; all of them if left.")
    ] = None,
    reference: Annotated[
        list[str] | None, typer.Option(help=f"{', '.join(FOLLOWED)}; several may follow.")
    ] = None,
    frequency: Annotated[
        list[float] | None, typer.Option(help="Base frequency, rad/s; several may follow.")
    ] = None,
    plant: Annotated[
        list[str] | None,
        typer.Option(help="analytic, rollers; both if left."),
    ] = None,
    model: Annotated[
        str,
        typer.Option(
            help="What is known of the robots beforehand, and their platform: model file or "
            "nominal. Robots are drawn around it, of the nominal one around paper."
        ),
    ] = "nominal",
    effect: effect_options.Effects = None,
    effects: effect_options.EffectsFile = None,
    robots: Annotated[int, typer.Option(min=1, max=1000, help="Robots on the analytic plant.")] = 5,
    roller_robots: Annotated[
        int, typer.Option(min=1, max=1000, help="Robots with real rollers.")
    ] = 3,
    noise: Annotated[bool, typer.Option(help="Noise of the sensors in what is observed.")] = True,
    steps: Annotated[
        int,
        typer.Option(
            min=0, max=10_000_000, help="Control periods of the test of predictive control."
        ),
    ] = 10_000,
    wrong: Annotated[
        bool, typer.Option(help="Ask which wrong parameter or missing effect costs the most.")
    ] = True,
    jobs: Annotated[
        int, typer.Option(min=0, max=1024, help="Processes at a time; one for each core if left.")
    ] = 0,
    cluster: console.Cluster = None,
    seed: console.Seed = 0,
    json_file: console.Json = None,
    force: console.Force = False,
    report: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write the page, its figures and films.")
    ] = None,
) -> None:
    """Compare controllers with what they believe about a robot: who tracks how well, and why.

    Robots with hidden effects (dry wheel friction, yaw scrub and a delay, or those of --effect) are
    drawn; each records a calibration log and is identified from it, with and without the effects.
    Controllers follow references with the nominal, the identified and the true model, paired robot
    by robot.  Without options a selection is run that takes less than five minutes on two cores;
    with --controller, --reference or --frequency all combinations.  Finished pieces are kept until
    all is done: a run that was stopped goes on where it was when it is called again.
    """
    from controllers.evaluation.claims import claims, solver_claims
    from controllers.evaluation.results import Results
    from youbot_cli.evaluate_tables import error_rows, gap_rows, tell
    from youbot_env.model_file import load_model, model_to_dict, write_atomically
    from youbot_env.simulation import Sensors

    page_file = None if report is None else report / "index.html"
    console.check_results(json_file, page_file, force=force)
    effect_options.load_effects(effects)
    nominal = load_model(model)
    blocks, skipped = chosen(controller, reference, frequency, plant, nominal)
    hidden = sizes(effect_options.parse_effects(effect)) if effect else HIDDEN
    counts = {"analytic": robots, "rollers": roller_robots}
    plants = list(dict.fromkeys(block.plant for block in blocks))
    settings = {"hidden": hidden, "noise": noise, "seed": seed, "log": LOG_SECONDS}
    settings |= {"effects": digest([effects]), "model": model_to_dict(nominal)}
    pieces = Pieces(place("evaluate", report, json_file), settings)
    parallel = Parallel(jobs or os.cpu_count() or 1, pieces, effects, cluster)
    with pieces:
        subjects = calibrate(plants, counts, nominal, hidden, seed, parallel)
        sensors = Sensors() if noise else None
        results = Results(drive(blocks, counts, subjects, sensors, parallel))
        costs = wrong_beliefs(subjects, sensors, parallel) if wrong else []
        checked = claims(results)
        solver = solver_runs(subjects[plants[0]][0], steps, pieces) if steps else None
        if solver:
            checked += solver_claims(solver["endurance"], solver["against_exact"])

        history = console.provenance(seed)
        used = {"hidden": hidden, "robots": {name: counts[name] for name in plants}}
        used |= {"noise": noise, "model": nominal.name, "platform": nominal.platform.name}
        result = {"setup": used | {"skipped": skipped}, "claims": [c.as_dict() for c in checked]}
        result |= {"errors": error_rows(results), "gap_closed": gap_rows(results)}
        result |= {"wrong_beliefs": [c.as_dict() for c in costs], "mpc": solver}
        address = None
        if report is not None:
            from youbot_cli.evaluate_page import evaluation_page

            with console.progress("page", 1) as show:
                words = console.in_words(history)
                page, films = evaluation_page(
                    results, checked, costs, solver, subjects, used, words
                )
                for name, film in films.items():
                    write_atomically(report / name, film)
                address = page.write(report)
                show(1)
        console.write_json(json_file, result | {"provenance": history})
    tell(results, checked, costs, skipped)
    if address:
        console.out.print(f"page: {address}", soft_wrap=True)


def chosen(
    controllers, references, frequencies, plants, nominal: Model
) -> tuple[list[Block], dict[str, str]]:
    """Blocks to run, and why some controllers cannot.

    Raises:
        ValueError: an unknown name, or a controller asked for by name that cannot be made.
    """
    from controllers import controller_names, find, make
    from controllers.evaluation.motions import FREQUENCIES
    from controllers.evaluation.plan import Block, default_blocks
    from controllers.evaluation.subjects import MODELS, PLANTS

    for name in plants or ():
        if name not in PLANTS:
            raise ValueError(f"--plant {name}: choose from {', '.join(PLANTS)}")
    for name in references or ():
        if name not in FOLLOWED:
            raise ValueError(f"--reference {name}: choose from {', '.join(FOLLOWED)}")
    for w in frequencies or ():
        if not 0.05 <= w <= 10:
            raise ValueError(f"--frequency {w:g}: give 0.05 to 10 rad/s")
    skipped = {}
    for name in controllers or controller_names():
        find(name)
        try:
            make(name, nominal)
        except (ImportError, OSError, ValueError) as error:
            if controllers:
                raise
            skipped[name] = str(error)
    usable = tuple(dict.fromkeys(controllers or controller_names()))
    usable = tuple(name for name in usable if name not in skipped)
    where = tuple(dict.fromkeys(plants or PLANTS))
    if not (controllers or references or frequencies):
        return default_blocks(usable, FOLLOWED, where), skipped
    followed = tuple(dict.fromkeys(references or FOLLOWED))
    at = tuple(sorted(set(frequencies or FREQUENCIES)))
    return [Block(name, usable, MODELS, followed, at) for name in where], skipped


def sizes(effects: dict[str, dict[str, float] | None]) -> dict[str, float]:
    """Hidden effects by their first parameter, of typical size where none is given."""
    from youbot_env.effects import get_effect

    found = {}
    for name, values in effects.items():
        first = get_effect(name).parameters[0]
        extra = sorted(set(values or ()) - {first.name})
        if extra:
            raise ValueError(
                f"--effect {name}.{extra[0]}: sizes are drawn for {name}.{first.name} alone; "
                f"leave it out"
            )
        found[name] = (values or {}).get(first.name, first.default)
    return found


def calibrate(
    plants: list[str], counts: dict, nominal: Model, hidden: dict, seed: int, parallel: Parallel
) -> dict[str, list[Subject]]:
    """Robots of each plant with their identified models."""
    from controllers.evaluation.subjects import draw_subjects
    from youbot_cli import evaluate_robots
    from youbot_env.model_file import load_model

    # The data sheet of the youBot is off by what it is; robots are as the one that was measured.
    centre = load_model("paper") if nominal == load_model("nominal") else nominal
    drawn = [
        subject
        for plant in plants
        for subject in draw_subjects(plant, counts[plant], centre, hidden, seed)
    ]
    work = [
        Piece(f"{s.plant} {s.number}", evaluate_robots.calibrated, (s, LOG_SECONDS, nominal))
        for s in drawn[::-1]
    ]
    kept = parallel.run("identifying robots", work, evaluate_robots.pack)
    found = [evaluate_robots.unpack(s, one) for s, one in zip(drawn[::-1], kept, strict=True)]
    return {
        plant: sorted((s for s in found if s.plant == plant), key=lambda s: s.number)
        for plant in plants
    }


def drive(
    blocks: list[Block], counts: dict, subjects: dict, sensors: Sensors | None, parallel: Parallel
) -> list[Run]:
    """All runs of all blocks."""
    from controllers.evaluation.plan import make_jobs, weight
    from controllers.evaluation.run import Run, run_all

    work = [
        Piece(
            f"{j.plant} {j.robot}, {j.controller}, {j.model}: {j.motions}",
            run_all,
            (subjects[j.plant][j.robot], j.controller, j.model, j.motions, sensors),
            weight(j),
        )
        for j in make_jobs(blocks, counts)
    ]
    kept = parallel.run(
        "driving",
        work,
        lambda runs: [asdict(r) for r in runs],
        lambda runs: [Run(**r) for r in runs],
    )
    return [run for runs in kept for run in runs]


def wrong_beliefs(
    subjects: dict, sensors: Sensors | None, parallel: Parallel
) -> list[tornado.Cost]:
    """Costs of wrong parameters and missing effects, on the first plant."""
    from controllers.evaluation import tornado

    asked = next(iter(subjects.values()))[:TORNADO_ROBOTS]
    work = [Piece(f"{s.plant} {s.number}", tornado.errors, (s, sensors)) for s in asked]
    found = parallel.run(
        "wrong on purpose",
        work,
        lambda errors: [[*change, error] for change, error in errors.items()],
        lambda rows: {tornado.Change(*row[:-1]): row[-1] for row in rows},
    )
    return tornado.costs(found)


def solver_runs(subject: Subject, steps: int, pieces: Pieces) -> dict[str, Any]:
    """Predictive control under stress and beside IPOPT; nothing else runs meanwhile."""
    from controllers.evaluation import solver_check

    with console.progress("predictive control", steps, "periods") as show:
        endurance = pieces.once(
            f"endurance {subject.plant}, {steps} steps",
            lambda: solver_check.endurance(subject, steps, show),
        )
    exact, motions = [], solver_check.EXACT_MOTIONS
    with console.progress("beside IPOPT", len(motions), "runs") as show:
        for number, motion in enumerate(motions, start=1):
            exact.append(
                pieces.once(
                    f"beside IPOPT {subject.plant}, {motion}",
                    lambda motion=motion: solver_check.against_exact(subject, motion),
                )
            )
            show(number)
    return {"endurance": endurance, "against_exact": exact}


def start() -> None:
    """Run the command line."""
    console.run(
        evaluate,
        "--controller kinematic mpc --plant rollers --report report",
        ("--controller", "--reference", "--frequency", "--plant"),
    )
