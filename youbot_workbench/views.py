"""What a session asks of the library, in its own process: views as plain data, ready to be drawn.

Every public method answers with the views that it changes, by name; ``worker`` calls them.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ident.comparison import Comparison, compare, rank
from ident.diagnosis.experiments import menu
from ident.diagnosis.minimum_detectable import MinimumDetectable
from ident.diagnosis.settings import SETTINGS
from ident.doctor import LogError
from ident.free_run import FreeRun, free_run
from ident.identifiability import observe_regression
from ident.improvement import LUMPS, METHOD
from ident.kept import keeping
from ident.log import Log, find_log
from ident.recording_words import in_words
from ident.regression import build_regression
from ident.report import interactive
from ident.report.compare import comparison_page
from ident.report.compare_time import player
from ident.report.diagnose import odds
from ident.report.look import pretty
from ident.report.outcome import interval, percent, rounded
from ident.results import Quantity, annotated
from ident.sensitivity import window_length
from ident.stepwise import ChainStage, Stepwise, Tried
from youbot_cli.log_options import (
    LogOptions,
    digests,
    long_together,
    moving_together,
    one_or_all,
    parse_mapping,
    refuse_double,
    refuse_two_robots,
    told_once,
    used_model,
    with_own_names,
)
from youbot_cli.pieces import Pieces
from youbot_env.effects import effect_names, get_effect
from youbot_env.effects_file import load_effects_file
from youbot_env.model import Model
from youbot_env.model_file import load_model, save_model
from youbot_env.parameters import MEANING
from youbot_env.references import Fourier, make_reference
from youbot_env.references.designed import motion_text

Views = dict[str, Any]
# Longest and shortest windows of free runs that are offered, s.
WINDOWS = (0.5, 1.0, 2.0, 5.0, 10.0)
# Seconds of a log that sliders show, so that they answer at once.
TRIED_SECONDS = 24.0
SLIDER = 3.0  # times the value, or the typical size, at the end of a slider
SECRET = "truth.yaml"
# What identifiable combinations are.
COMBINED = {
    "x1+x3": "m0 L² and the wheels' spin inertia",
    "x2+x3": "I0 and the wheels' spin inertia",
}
# Views of the chain, empty where there is none.
OF_CHAIN = ("bar", "which", "compare", "where", "trust", "use", "next", "attempt", "play",
            "verdict", "preview", "sliders", "control")  # fmt: skip


class SessionViews:
    """One session: its logs, its chain of models, and views of them.

    Args:
        folder: of the session; logs, models and finished pieces of work lie there.
        tell: called with what is being done.
        push: called with views as soon as they are there, while work goes on.
    """

    def __init__(self, folder: Path, tell: Callable[[str], None], push: Callable[[Views], None]):
        self.folder, self.tell, self.push = folder, tell, push
        self.settings: dict[str, Any] = {}
        self.logs: list[Log] = []
        self.tests: list[Log] = []
        self.chain: Stepwise | None = None
        self._effects_known = False
        self._compared: dict[tuple, Comparison] = {}
        self._runs: dict[tuple, FreeRun] = {}

    # Logs

    def check(self, settings: dict[str, Any]) -> Views:
        """Read the logs that the settings name; the doctor says what is odd."""
        self.settings, self.chain = settings, None
        self._compared.clear()
        self._runs.clear()
        if settings.get("effects") and not self._effects_known:
            load_effects_file(Path(settings["effects"]))
            self._effects_known = True
        told, parts, usable = [], {"fit": [], "test": []}, True
        for role in parts:
            for source in settings["logs" if role == "fit" else "tests"]:
                self.tell(f"reading {Path(source).name}")
                log, entry = self._read(source, role)
                told.append(entry)
                usable = usable and log is not None
                parts[role] += [] if log is None else [log]
        problem = ""
        if usable and parts["fit"]:
            try:
                everything = [*parts["fit"], *parts["test"]]
                refuse_double(everything)
                refuse_two_robots(everything)
                named = told_once(with_own_names(everything))
                count = len(parts["fit"])
                halves = named[:count], named[count:]
                self.logs, self.tests = (moving_together(long_together(h)) for h in halves)
                for entry, log in zip(told, [*self.logs, *self.tests], strict=True):
                    entry |= {"name": log.name, "findings": _findings(log.findings)}
            except ValueError as error:
                usable, problem = False, str(error)
        elif not parts["fit"] and usable:
            usable, problem = False, "give a log to fit"
        figure = interactive.recorded(parts["fit"][0]) if parts["fit"] else None
        check = {"logs": told, "usable": usable, "problem": problem, "figure": figure,
                 "recording": []}  # fmt: skip
        return {"check": check} | dict.fromkeys(OF_CHAIN)

    def _read(self, source: str, role: str) -> tuple[Log | None, dict[str, Any]]:
        entry: dict[str, Any] = {"source": source, "name": Path(source).name, "role": role,
                                 "facts": "", "error": "", "findings": []}  # fmt: skip
        settings = self.settings
        options = LogOptions(platform=settings.get("platform") or None,
                             lever=settings.get("lever"))  # fmt: skip
        try:
            given = options.given(load_model(settings["model"]))
            log = Log.load(
                find_log(source), given, parse_mapping(settings.get("mapping")) or None,
                settings.get("kt"), settings.get("gear"), accept=tuple(settings.get("accept", ())),
                lever=settings.get("lever"),
            )  # fmt: skip
        except LogError as error:
            entry |= {"error": "this log cannot be used yet", "findings": _findings(error.findings)}
            return None, entry
        except (ValueError, OSError) as error:
            entry["error"] = str(error)
            return None, entry
        channels = ("wheel_velocity", "body_velocity", "wheel_torque", "wheel_voltage", "reference",
                    "pose", "battery_voltage")  # fmt: skip
        there = [name.replace("_", " ") for name in channels if getattr(log, name) is not None]
        entry["facts"] = (
            f"{log.duration:.3g} s at {1 / log.dt:.3g} Hz, {len(log.time)} rows: {', '.join(there)}"
        )
        entry |= {"name": log.name, "findings": _findings(log.findings)}
        return log, entry

    # The chain

    def start(self, settings: dict[str, Any], added: list[str] | None = None) -> Views:
        """Fit the base model, and add effects that a session had added before."""
        views = self.check(settings)
        if not views["check"]["usable"]:
            return views
        self.push(views)
        start = used_model(load_model(settings["model"]), self.logs)
        used = {"logs": [log.digest for log in self.logs], "model": settings["model"],
                "tests": [log.digest for log in self.tests]}  # fmt: skip
        with keeping(Pieces(self.folder / "kept", used)):
            try:
                self.chain = Stepwise(
                    self.logs, start, one_or_all(self.tests), settings.get("seed", 0), self.tell
                )
                for effect in added or ():
                    self.chain.add(effect)
            except ValueError as error:
                views["check"] |= {"usable": False, "problem": str(error)}
                return views
        instruments = [one for r in self.chain.ground.records for one in r.instruments]
        views["check"]["recording"] = in_words(instruments)
        differs = self.chain.ground.differs
        views["check"]["recording"] += [f"{name}: {f.message}" for name, f in differs.items()]
        return views | self._after()

    def which(self) -> Views:
        """Try every effect on top of the last stage."""
        tried = self._chain.tried()
        verdict, reason, experiment = self._chain.verdict()
        rows = [_tried_row(one) for one in tried]
        untold = self._untried({one.effect for one in tried})
        told = {"verdict": verdict, "reason": in_titles(reason)}
        return {
            "which": {"rows": rows, "untried": untold, "floor": self._chain.errors.floor} | told,
            "verdict": told,
            "next": self._next(experiment),
        }

    def add(self, effect: str) -> Views:
        """Add an effect, fit everything again, and try what is left."""
        self._chain.add(effect)
        self.push(self._after())
        return self.which()

    def back(self, stage: int) -> Views:
        """Step back to a stage and try what may be added there."""
        self._chain.back(stage)
        self.push(self._after())
        return self.which()

    def loop(self) -> Views:
        """Add the best again and again until nothing passes, as ``improve`` does."""
        views = self.which()
        for _ in range(SETTINGS.most_rounds + SETTINGS.most_effects):
            best = self._chain.best
            if best is None:
                break
            self.push(views)
            views = self.add(best.effect)
        return views

    def show(self, window: float | None, log: int | None, signal: str, regime: str | None) -> Views:
        """Draw comparison and residuals with another window, log, signal or regime."""
        return {"compare": self._compare_view(window, log, regime),
                "where": self._where_view(window, log, signal, regime)}  # fmt: skip

    def preview(self, effect: str, log: int | None, signal: str) -> Views:
        """Draw what an effect would do to the residual torque, beside the last stage."""
        chain = self._chain
        one = next(one for one in chain.tried() if one.effect == effect)
        last = len(chain.stages) - 1
        number = self._log_number(log)
        title = get_effect(effect).title
        if one.refined is None:
            words = (f"{title}: its linear trace explains too little to fit it; Add anyway shows "
                     "the result")  # fmt: skip
            return {"preview": {"effect": effect, "figure": None, "words": words}}
        model = one.refined.simulations[number].model
        now = self._comparison(last, None, number)
        then = compare(chain.parts[number].log, [replace(model, name=f"with {effect}")])[0]
        pair = [(self._chip(chain.stages[last]), last, now),
                (f"with {title.lower()}", last + 1, then)]  # fmt: skip
        if signal in interactive.PLANES:
            figure = interactive.residual_map(pair, signal)
        else:
            figure = interactive.residual_torques(pair, signal)
        words = f"{title}: residual torque now, and with it fitted"
        return {"preview": {"effect": effect, "figure": figure, "words": words}}

    def attempt(self, values: dict[str, float], log: int | None) -> Views:
        """Simulate the last stage with some values changed by hand."""
        chain, number = self._chain, self._log_number(log)
        stage = chain.stages[-1]
        model = stage.models[number]
        base = {k: v for k, v in values.items() if "." not in k}
        changed = replace(model, parameters=replace(model.parameters, **base), covariance=None)
        names = changed.names()
        changed = changed.with_values(
            [values.get(name, now) if "." in name else now
             for name, now in zip(names, changed.values(), strict=True)]
        )  # fmt: skip
        log_of = chain.parts[number].log
        whole = log_of.part(log_of.time[0], log_of.time[0] + min(TRIED_SECONDS, log_of.duration))
        window = window_length(log_of)
        last = len(chain.stages) - 1
        runs = [(self._chip(stage), last, free_run(whole, model, window)),
                ("tried", last + 1, free_run(whole, changed, window))]  # fmt: skip
        figure = interactive.velocities(runs, float(log_of.time[0]), window=window)
        errors = [run.nrmse for _, _, run in runs]
        words = (
            f"free-run error of the first {whole.duration:.0f} s: {percent(errors[0])} as fitted, "
            f"{percent(errors[1])} as tried"
        )
        return {"attempt": {"figure": figure, "words": words, "values": values}}

    def play(self, log: int | None, window: float | None) -> Views:
        """The worst stretches as motion."""
        chain, number = self._chain, self._log_number(log)
        last = len(chain.stages) - 1
        shown = [k for k in {1, last - 1, last} if k > 0]
        drawn = [(interactive.stage_color(k), self._comparison(k, window, number))
                 for k in sorted(shown)]  # fmt: skip
        live = player(drawn)
        return {"play": {"html": live.html, "caption": live.caption}}

    # What to record, what to use

    def plan(self, motion: str) -> Views:
        """Draw another motion of the menu."""
        view = self._next(None, motion)
        return {"next": view}

    def hidden(self, seed: int, plant: str) -> Views:
        """Record a robot in which something is hidden; the answer lies in the session's folder."""
        from ident.benchmark.cases import record_case

        self.tell("recording a robot of which you do not know everything")
        case = _hidden_case(seed, plant)
        recorded = record_case(case)
        files = []
        for log, name in ((recorded.fit, "recorded.csv"), (recorded.verify, "recorded_test.csv")):
            path = self.folder / "logs" / name
            log.save(path)
            files.append(str(path))
        save_model(replace(recorded.truth, name="truth"), self.folder / SECRET)
        self.settings = {"hidden": {"seed": seed, "plant": plant}}
        return {"recorded": {"logs": files[:1], "tests": files[1:], "seed": seed, "plant": plant}}

    def answer(self) -> Views:
        """What was hidden in the recorded robot, beside what was found."""
        truth = load_model(self.folder / SECRET)
        hidden = [
            {"effect": a.identifier, "title": a.effect.title,
             "values": {k: f"{v:.3g} {a.effect.parameter_of(k).unit}".strip()
                        for k, v in a.values.items()}}
            for a in truth.effects
        ]  # fmt: skip
        found = list(self._chain.added) if self.chain else []
        names = {one["effect"] for one in hidden}
        right = bool(names & set(found))
        rivals = {r for step in self.chain.steps for r in step.group} if self.chain else set()
        if right:
            words = "You found it."
        elif names & rivals:
            words = "What you added looks like it; the truth is listed among its rivals."
        else:
            words = "That is not what you have added so far." if found else "You added nothing yet."
        return {"answer": {"hidden": hidden, "found": found, "right": right, "words": words}}

    def simulate(self, motion: str) -> Views:
        """Record the robot with the hidden effect once more, in a proposed motion."""
        from ident.benchmark.cases import record_case, record_experiment

        case = _hidden_case(**self.settings["hidden"])
        self.tell(f"recording the same robot in {motion}")
        log = record_experiment(case, record_case(case), motion)
        path = self.folder / "logs" / f"recorded_{motion}.csv"
        log.save(path)
        return {"recorded_more": str(path)}

    def save(self) -> Views:
        """Write the last model into the session's folder."""
        path = self._write_model()
        return {"use": self._use_view(path)}

    def control(self) -> Views:
        """Follow a figure of eight with controllers that believe the refit and the last model."""
        from youbot_cli.improve import tried

        chain = self._chain
        self.tell("driving both models round a figure of eight")
        found = tried(chain.stages[1].model, chain.stages[-1].model, self.logs, 0)
        return {"control": {"words": str(found), "base": found.base, "final": found.final}}

    def report(self) -> Views:
        """Write a static page that compares all stages."""
        chain, number = self._chain, self._chain.judging
        self.tell("drawing the report")
        found = [self._comparison(k, None, number) for k in range(len(chain.stages))]
        history = {"logs": ", ".join(log.name for log in self.logs),
                   "tests": ", ".join(log.name for log in self.tests),
                   "added": ", ".join(chain.added) or "nothing"}  # fmt: skip
        page = comparison_page(rank(found), history, [*self.logs, *self.tests])
        return {"report": str(page.write(self.folder / "report"))}

    # Views

    @property
    def _chain(self) -> Stepwise:
        if self.chain is None:
            raise ValueError("no model is fitted yet; open a log first")
        return self.chain

    def _after(self) -> Views:
        """What changes with the chain."""
        chain = self._chain
        self.tell("drawing")
        return {
            "bar": self._bar(),
            "verdict": None,
            "which": None,
            "preview": None,
            "attempt": None,
            "play": None,
            "control": None,
            "compare": self._compare_view(None, None, None),
            "where": self._where_view(None, None, interactive.SIGNALS[0], None),
            "trust": self._trust_view(),
            "sliders": self._sliders(),
            "use": self._use_view(self._write_model()),
            "next": self._next(None),
            "added": list(chain.added),
        }

    def _bar(self) -> dict[str, Any]:
        chain = self._chain
        errors, stages = chain.errors, chain.stages
        names = [self._chip(stage) for stage in stages]
        floor = errors.floor
        held = chain.held_out(chain.judging)
        log = chain.parts[chain.judging].log
        words = (
            f"{errors.what}, rms over {errors.windows} windows of {window_length(log):.3g} s of "
            f"{log.name} that nothing is fitted to or chosen by"
        )
        return {
            "names": names,
            "errors": [stage.nrmse for stage in stages],
            "axes": [stage.axes.tolist() for stage in stages],
            "floor": floor,
            "rolling": errors.rolling,
            "excuse": errors.excuse,
            "words": words,
            "held": held,
            "figure": interactive.staircase(names, [stage.nrmse for stage in stages], floor),
            "drop": list(errors.drop_ci95),
            "logs": [part.log.name for part in chain.parts],
            "log": chain.judging,
        }

    def _chip(self, stage: ChainStage) -> str:
        if stage.name == "start":
            return Path(str(self.settings["model"])).stem
        if not stage.added:
            return "refit"
        return f"+ {get_effect(stage.added).title.lower()}{_size_of(stage)}"

    def _log_number(self, log: int | None) -> int:
        return self._chain.judging if log is None else log

    def _run(self, stage: int, window: float, log: int) -> FreeRun:
        chain = self._chain
        key = (stage, chain.added[: max(stage - 1, 0)], window, log)
        if key not in self._runs:
            self._runs[key] = free_run(
                chain.parts[log].log, chain.stages[stage].models[log], window
            )
        return self._runs[key]

    def _comparison(self, stage: int, window: float | None, log: int) -> Comparison:
        chain = self._chain
        window = window or window_length(chain.parts[log].log)
        key = (stage, chain.added[: max(stage - 1, 0)], window, log)
        if key not in self._compared:
            one = chain.stages[stage]
            model = replace(one.models[log], name=self._chip(one))
            self._compared[key] = compare(chain.parts[log].log, [model], window)[0]
        return self._compared[key]

    def _compare_view(
        self, window: float | None, log: int | None, regime: str | None
    ) -> dict[str, Any]:
        chain, number = self._chain, self._log_number(log)
        part = chain.parts[number]
        usual = window_length(part.log)
        chosen = window or usual
        runs = [(self._chip(stage), k, self._run(k, chosen, number))
                for k, stage in enumerate(chain.stages)]  # fmt: skip
        marked = []
        if regime:
            marked = interactive.regime_spans(
                self._comparison(len(chain.stages) - 1, None, number), regime
            )
        start = float(part.log.time[0])
        held = chain.held_out(number)
        figure = interactive.velocities(runs, start, held, marked, chosen)
        rows = [
            [name, *(rounded(v, v) for v in _held(run, held, start).rmse),
             percent(_held(run, held, start).nrmse), percent(run.nrmse)]
            for name, _, run in runs
        ]  # fmt: skip
        offered = sorted({*(w for w in WINDOWS if w < 0.5 * part.log.duration), round(usual, 3)})
        return {"figure": figure, "rows": rows, "window": chosen, "windows": offered,
                "usual": usual, "log": number, "logs": [p.log.name for p in chain.parts],
                "held": bool(held), "regime": regime}  # fmt: skip

    def _where_view(
        self, window: float | None, log: int | None, signal: str, regime: str | None
    ) -> dict[str, Any]:
        chain, number = self._chain, self._log_number(log)
        last = len(chain.stages) - 1
        shown = [k for k in (last - 1, last) if k > 0]
        found = [(self._chip(chain.stages[k]), k, self._comparison(k, window, number))
                 for k in shown]  # fmt: skip
        try:
            drawn = (interactive.residual_map(found, signal) if signal in interactive.PLANES
                     else interactive.residual_torques(found, signal, regime))  # fmt: skip
            figure, words = drawn, ""
        except ValueError as error:
            figure, words = None, str(error)
        return {
            "figure": figure,
            "words": words,
            "regimes": interactive.regimes(found[-1][2].where),
            "of": found[-1][0],
            "signal": signal,
            "signals": [*interactive.SIGNALS, *interactive.PLANES],
            "regime": regime,
            "depends_on": [[s, g] for s, g in chain.round.dependences()] if chain.looked else [],
        }

    def _trust_view(self) -> dict[str, Any]:
        chain = self._chain
        stages = [(self._chip(s), k, s.base) for k, s in enumerate(chain.stages) if s.base]
        last, errors = chain.stages[-1], chain.errors
        rows = [_parameter_row(name, q, last.shifts.get(name)) for name, q in last.base.items()]
        for effect, values in last.sizes.items():
            for flat, q in values.items():
                told = get_effect(effect).parameter_of(flat)
                row = _parameter_row(f"{effect}.{flat}", q, None)
                rows.append(row | {"meaning": told.meaning})
        fitted = chain.parts[0].log
        words = list(observe_regression(build_regression(fitted, last.model), last.model).words)
        number = 0
        pair = [(self._chip(chain.stages[k]), k, self._comparison(k, None, number))
                for k in sorted({1, len(chain.stages) - 1})]  # fmt: skip
        floor = float(np.hypot(errors.floor, errors.rolling))
        warning = ""
        if errors.after > 1.2 * floor:
            warning = (
                f"The model still leaves {percent(errors.after)}, beside {errors.excuse}. "
                "Intervals come from scatter between stretches of the log; they do not hold what "
                "a missing effect does to the values. Add what is missing first."
            )
        return {
            "figure": interactive.parameters(stages),
            "rows": rows,
            "words": words,
            "warning": warning,
            "autocorrelation": interactive.autocorrelation(pair),
            "account": interactive.account(errors.account),
            "excuse": errors.excuse,
        }

    def _sliders(self) -> list[dict[str, Any]]:
        """What may be tried by hand: values of the last model and where their sliders end."""
        model, found = self._chain.stages[-1].model, []
        base = self._chain.stages[-1].base
        for name, value in _parameters(model).items():
            q = base.get(name)
            found.append(
                _slider(name, MEANING[name], value, q.unit if q else "", 0.2 * value, 2 * value)
            )
        for active in model.effects:
            for flat, value in active.values.items():
                p = active.effect.parameter_of(flat)
                far = SLIDER * max(abs(value), abs(p.default))
                low, high = max(p.bounds[0], -far), min(p.bounds[1], far)
                name = f"{active.identifier}.{flat}"
                found.append(_slider(name, active.effect.title, value, p.unit, low, high))
        return [one for one in found if one["low"] < one["high"]]

    def _write_model(self) -> Path:
        chain, last = self._chain, self._chain.stages[-1]
        parameters = {k: q for k, q in last.base.items() if k not in LUMPS}
        model = annotated(replace(last.model, name="workbench"), parameters, METHOD, self.logs)
        made = {"method": "stepwise, by hand", "start": str(self.settings["model"]),
                "logs": digests([*self.logs, *self.tests]), "added": list(chain.added)}  # fmt: skip
        path = self.folder / "model.yaml"
        save_model(replace(model, provenance=(model.provenance or {}) | made), path)
        return path

    def _use_view(self, path: Path) -> dict[str, Any]:
        chain, last = self._chain, self._chain.stages[-1]
        logs = [Path(s).name for s in self.settings["logs"]]
        tests = [Path(s).name for s in self.settings["tests"]]
        bundled = [Path(s).stem if Path(s).stem.startswith("youbot_") else s for s in logs + tests]
        logs, tests = bundled[: len(logs)], bundled[len(logs) :]
        start, test = self.settings["model"], f", test={tests[0]!r}" if tests else ""
        behind = f" --test {' '.join(tests)}" if tests else ""
        add = "".join(f" --add {effect}" for effect in chain.added)
        added = f", add={tuple(chain.added)!r}" if chain.added else ""
        python = [
            "from ident import identify, improve",
            "# the whole loop, or these effects alone",
            f"found = improve({logs[0]!r}, {start!r}{test})",
            f"mine = identify({logs[0]!r}, {start!r}{added}, method='free-run'{test})",
            "",
            "import gymnasium as gym, youbot_env",
            'env = gym.make("YouBot-v0", model="model.yaml")',
            "",
            "from controllers import make",
            'controller = make("computed_torque", model="model.yaml")',
        ]
        shell = [
            f"youbot improve {' '.join(logs)}{behind} --model {start} --out model.yaml",
            f"youbot identify {' '.join(logs)}{behind} --model {start}{add} --method free-run "
            "--out model.yaml",
            f"youbot compare {' '.join(tests or logs)} --model {start} model.yaml --report report",
        ]
        return {"yaml": path.read_text(encoding="utf-8"), "path": str(path), "python": python,
                "shell": shell, "name": self._chip(last)}  # fmt: skip

    def _next(self, experiment, motion: str | None = None) -> dict[str, Any]:
        proposed = experiment.motion if experiment else None
        chosen = motion or proposed or "calibration"
        known = menu()
        names = [*known, *(n for n in ("smooth_random", "multisine") if n not in known)]
        reference = known.get(chosen) or make_reference(chosen)
        seconds = 112.0 if chosen == "calibration" else SETTINGS.experiment_seconds
        words = ""
        if experiment and experiment.separates:
            rivals = in_titles(" from ".join(experiment.separates))
            words = (
                f"{experiment.purpose}: tells {rivals}, expected "
                f"odds {odds(experiment.odds)}, by simulations of each with the other fitted"
            )
        elif experiment:
            words = experiment.purpose
        purpose = getattr(reference, "purpose", "") or chosen.replace("_", " ")
        return {
            "motion": chosen,
            "motions": names,
            "proposed": proposed,
            "words": words,
            "purpose": purpose,
            "odds": [[experiment.motion, odds(experiment.odds)]]
            + [[name, odds(v)] for name, v in experiment.alternatives]
            if experiment and experiment.odds
            else [],
            "figure": interactive.motion(reference, seconds),
            "yaml": motion_text(reference) if isinstance(reference, Fourier) else None,
            "command": f"youbot record --model model.yaml --motion {chosen} --seconds {seconds:g}",
        }

    def _untried(self, tried: set[str]) -> list[dict[str, str]]:
        from ident.diagnosis.trials import untried

        chain = self._chain
        reasons = untried(chain.round.model, chain.round.logs)
        return [{"effect": k, "title": get_effect(k).title, "reason": v}
                for k, v in reasons.items() if k not in tried]  # fmt: skip


def _hidden_case(seed: int, plant: str):
    """The robot that a seed draws, and what is hidden in it."""
    from ident.benchmark.cases import ROLLER_EFFECTS, Case
    from ident.benchmark.hidden import EFFECTS

    rng, rollers = np.random.default_rng(seed), plant == "rollers"
    effect = str(rng.choice(ROLLER_EFFECTS if rollers else EFFECTS))
    part = "rollers" if rollers else "single"
    return Case(part, (effect,), 1.0, int(rng.integers(1000)), seed)


def _findings(findings) -> list[dict[str, Any]]:
    return [f.as_dict() | {"acceptable": f.acceptable} for f in findings]


def _held(run: FreeRun, spans: list[tuple[float, float]], start: float) -> FreeRun:
    """The held-out part of a run; all of it where nothing was held out."""
    time = run.time - start
    rows = np.zeros(len(time), bool)
    for begin, end in spans:
        rows |= (time >= begin) & (time <= end)
    if not rows.any():
        return run
    return FreeRun(run.time[rows], run.simulated[rows], run.measured[rows], run.window[rows])


def _tried_row(one: Tried) -> dict[str, Any]:
    effect, traced = get_effect(one.effect), one.traced
    size, ci95 = traced.size, traced.ci95
    shown = f"{rounded(size, _error(traced))} {traced.unit}".strip()
    if one.refined is not None:
        values = one.refined.values
        name, value = next(iter(values.items()))
        unit = effect.parameter_of(name).unit
        shown = f"{value:.3g} {unit}".strip()
        if len(values) > 1:
            shown += f" and {len(values) - 1} more"
    return {
        "effect": one.effect,
        "title": effect.title,
        "equation": mathml(effect.equation),
        "regime": effect.regime,
        "after": one.after,
        "gain": traced.gain,
        "passes": one.passes,
        "background": one.background,
        "rivals": [get_effect(r).title for r in one.rivals],
        "alike": [get_effect(r).title for r in effect.confusables],
        "p": traced.p,
        "size": shown,
        "ci95": f"{ci95[0]:.3g} … {ci95[1]:.3g} {traced.unit}".strip(),
        "parameter": traced.parameter,
        "smallest": None if traced.smallest is None else f"{traced.smallest:.2g} {traced.unit}",
        "power": traced.power,
    }


def _error(traced: MinimumDetectable) -> float:
    return max((traced.ci95[1] - traced.ci95[0]) / 4, 1e-12)


def in_titles(text: str) -> str:
    """A sentence in which effects are called by their titles."""
    names = sorted(effect_names(), key=len, reverse=True)
    for name in names:
        text = re.sub(rf"\b{name}\b", get_effect(name).title.lower(), text)
    return text


def mathml(equation: str) -> str:
    """A LaTeX equation as MathML, which browsers draw without scripts and fonts.

    Browsers do not break formulas: where one is a list, each of its entries gets a line.
    """
    from latex2mathml.converter import convert

    parts = re.split(r",\s*\\quad", equation)
    whole = all(part.count("{") == part.count("}") for part in parts)
    return "".join(f"<div>{convert(part)}</div>" for part in (parts if whole else [equation]))


def _size_of(stage: ChainStage) -> str:
    values = stage.sizes.get(stage.added, {})
    if len(values) != 1:
        return ""
    q = next(iter(values.values()))
    return f" {q.value:.3g} {q.unit}"


def _parameter_row(name: str, q: Quantity, shift: float | None) -> dict[str, Any]:
    return {"name": name, "value": rounded(q.value, q.se), "ci95": interval(q),
            "unit": pretty(q.unit), "shift": None if shift is None else round(shift, 1),
            "meaning": COMBINED.get(name) or MEANING.get(name, "")}  # fmt: skip


def _slider(
    name: str, title: str, value: float, unit: str, low: float, high: float
) -> dict[str, Any]:
    low, high = min(low, high, value), max(low, high, value)
    return {
        "name": name,
        "title": title,
        "value": value,
        "unit": pretty(unit),
        "low": low,
        "high": high,
    }


def _parameters(model: Model) -> dict[str, float]:
    return {k: float(v) for k, v in model.parameters.as_dict().items()}
