"""The page of a training run, and the picture of learning curves."""

from __future__ import annotations

import numpy as np

from ident.report.look import IDENTIFIED, INK, figure
from ident.report.page import Grid, Page, Picture, Section

COLOURS = (IDENTIFIED, "#2f8f6b", "#8e5bb0", "#c9415c", "#7a5a3a")

CAPTION = (
    "Rms position error of the policy without exploration, settled, on a multisine at 1 rad/s; "
    "dashed: the kinematic controller on the same motion."
)
EXAM_NOTE = (
    "Rms position errors of runs from a displaced rest, after 2 s; with start: policy / kinematic "
    "over the whole run."
)
HEAD = ("motion", "policy, mm", "kinematic, mm", "times better (95 %)", "seeds won, %",
        "both with start, mm", "heading, deg")  # fmt: skip


def training_page(record: dict, marks: list) -> Page:
    """What a run has to say: verdict, curve, exam, recipe."""
    name, last = record["algorithm"], record["last_session"]
    rival = 1e3 * marks[0].kinematic.position.mean()
    better = "beats" if record["beats_kinematic"] else "does not beat"
    curve = learning_curves([(name, record)], rival)
    worst = min(marks, key=lambda mark: mark.times.value)
    rows = [
        (
            mark.trial.motion,
            *(millimetres(side.position) for side in (mark.policy, mark.kinematic)),
            f"{mark.times.value:.1f} ({mark.times.low:.1f} to {mark.times.high:.1f})",
            f"{100 * mark.wins:.0f}",
            " / ".join(millimetres(side.run) for side in (mark.policy, mark.kinematic)),
            f"{np.degrees(mark.policy.heading.mean()):.3f}",
        )
        for mark in marks
    ]
    recipe = {k: v for k, v in record["recipe"].items() if not isinstance(v, dict)}
    recipe |= record["recipe"]["extra"]
    return Page(
        title=f"Training: {name} on {record['world']}",
        verdict=f"{name} {better} the kinematic controller at 1 rad/s",
        good=record["beats_kinematic"],
        lead=f"Learned on robots of the world '{record['world']}' around the model "
        f"'{record['model']}'; examined on {marks[0].trial.robots} unseen seeds of each motion.",
        figures=[
            (f"{record['wall_seconds'] / 60:.1f} min", "training, wall time"),
            (f"{record['steps'] / 1e6:.2g} M", "control periods"),
            (f"{last['steps_per_second']:,.0f} 1/s", "control periods a second"),
            (f"{worst.times.value:.1f}x", f"smaller error, worst motion ({worst.trial.motion})"),
        ],
        sections=[
            Section(
                "How it learned",
                [Picture("learning_curve", curve, CAPTION)],
            ),
            Section(
                "The exam",
                [Grid(HEAD, rows, EXAM_NOTE)],
                "Both controllers drive the same motions from the same starts.",
            ),
            Section("The recipe", [Grid(("setting", "value"), list(map(_row, recipe.items())))]),
        ],
        provenance={k: str(v) for k, v in record["provenance"].items()},
    )


def millimetres(errors) -> str:
    """The mean of errors in m, as a table shows it."""
    return f"{1e3 * np.mean(errors):.2f}"


def _row(item: tuple) -> tuple[str, str]:
    name, value = item
    shown = " x ".join(map(str, value)) if isinstance(value, tuple | list) else str(value)
    return name, shown


@figure(4.2)
def learning_curves(canvas, runs: list[tuple[str, dict]], rival: float) -> None:
    """Draw the curves of runs, (label, record), on a figure of their own; see ``curves``."""
    curves(canvas.subplots(), runs, rival)
    canvas.tight_layout()


def curves(axis, runs: list[tuple[str, dict]], rival: float) -> None:
    """Draw settled error, mm, against control periods; ``rival`` is the kinematic error, mm."""
    for (label, record), colour in zip(runs, COLOURS, strict=False):
        looks = record.get("learning_curve", [])
        steps = [1e-6 * look["steps"] for look in looks]
        error = [1e3 * look["position"] for look in looks]
        axis.semilogy(steps, error, color=colour, marker="o", markersize=3, label=label)
    axis.axhline(rival, color=INK, linestyle="--", label="kinematic")
    axis.set_xlabel("training, million control periods")
    axis.set_ylabel("position error, mm")
    axis.set_xlim(left=0)
    axis.legend()
