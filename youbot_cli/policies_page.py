"""The page and the picture of trained policies: how they learned, and what a hidden robot costs."""

from __future__ import annotations

import numpy as np

from controllers.rl_policy import Policy
from controllers.training.exam import Mark
from controllers.training.transfer import Transfer
from ident.report.look import INK, MEASURED, figure
from ident.report.page import Grid, Page, Picture, Section
from youbot_cli.train_page import EXAM_NOTE, curves, millimetres

CAPTION = (
    "Left: rms position error of the policies while they learn, settled, multisine at 1 rad/s, on "
    "the robot in the middle of their training; dashed: the kinematic controller on the nominal "
    "robot. Right: the same error over multisine, eight and circle, on robots of the training (or "
    "the model that the controller believes) and on the hidden one, mean and 95 % interval over "
    "the seeds."
)


def policies_page(
    record: dict,
    policies: dict[str, Policy],
    exams: dict[str, list[Mark]],
    losses: dict[str, Transfer],
) -> Page:
    """What the evaluation of policies has to say."""
    good = all(record["beats_kinematic"].values())
    times = min(mark.times.value for marks in exams.values() for mark in marks)
    longest = max(one.training.get("wall_seconds", np.nan) for one in policies.values())
    worlds = record["worlds"]
    lead = f"{record['seeds']} unseen seeds of each motion at 1 rad/s, paired."
    if worlds:
        lead += (
            f" On the hidden robot PPO trained on {worlds['best_on_hidden']} robots has the "
            f"smallest error; against the robots of its own training, the one trained on "
            f"{worlds['least_degradation']} robots loses least."
        )
    return Page(
        title="Trained policies",
        verdict="Every policy beats the kinematic controller at 1 rad/s"
        if good
        else "Not every policy beats the kinematic controller at 1 rad/s",
        good=good,
        lead=lead,
        figures=[
            (f"{times:.1f}x", "smaller error than kinematic, worst policy and motion"),
            (f"{longest / 60:.1f} min", "longest training, wall time"),
        ],
        sections=[
            Section("Learning, and the hidden robot",
                    [Picture("policies", policies_figure(policies, exams, losses), CAPTION)]),
            Section("On robots of the training", [exam_grid(exams)]),
            Section("On the hidden robot", [transfer_grid(losses)]),
            Section("How they came about", [training_grid(policies)]),
        ],
        provenance={k: str(v) for k, v in record["provenance"].items()},
    )  # fmt: skip


def exam_grid(exams: dict[str, list[Mark]]) -> Grid:
    """Policies beside the kinematic controller."""
    rows = [
        (
            label,
            mark.trial.motion,
            *(millimetres(side.position) for side in (mark.policy, mark.kinematic)),
            f"{mark.times.value:.1f} ({mark.times.low:.1f} to {mark.times.high:.1f})",
            f"{100 * mark.wins:.0f}",
            " / ".join(millimetres(side.run) for side in (mark.policy, mark.kinematic)),
        )
        for label, marks in exams.items()
        for mark in marks
    ]
    head = ("policy", "motion", "policy, mm", "kinematic, mm", "times better (95 %)",
            "seeds won, %", "both with start, mm")  # fmt: skip
    return Grid(head, rows, EXAM_NOTE, words=(0, 1))


def transfer_grid(losses: dict[str, Transfer]) -> Grid:
    """What the hidden robot costs."""
    rows = []
    for label, loss in losses.items():
        cost = loss.degradation
        rows.append(
            (
                label, f"{1e3 * loss.known.mean():.2f}", f"{1e3 * loss.hidden.mean():.2f}",
                f"{1e3 * cost.value:.2f} ({1e3 * cost.low:.2f} to {1e3 * cost.high:.2f})",
                f"{np.degrees(loss.heading.mean()):.3f}", f"{loss.lost}",
            )
        )  # fmt: skip
    head = ("controller", "known robots, mm", "hidden robot, mm", "lost by it, mm (95 %)",
            "heading there, deg", "runs lost")  # fmt: skip
    note = (
        "Known: robots of the training, or the model that the controller believes. A loss below "
        "zero: the hidden robot is easier than those of the training. Intervals are over the runs "
        "of one hidden robot and one training each; another training may differ by more."
    )
    return Grid(head, rows, note)


def training_grid(policies: dict[str, Policy]) -> Grid:
    """Commands, budgets and speeds."""
    rows = []
    for label, one in policies.items():
        record, last = one.training, one.training.get("last_session", {})
        rows.append(
            (
                label, record.get("provenance", {}).get("command", "").partition(".py ")[2],
                f"{record.get('wall_seconds', 0) / 60:.1f}",
                f"{last.get('cpu_seconds', 0) / 60:.1f}",
            )
        )  # fmt: skip
    head = ("policy", "options of youbot train", "wall, min", "processor, min")
    return Grid(head, rows, "Weights, normalisation and curve are in the policy files.", (0, 1))


@figure(4.4)
def policies_figure(canvas, policies, exams, losses) -> None:
    """Draw learning curves, and errors on the known and on the hidden robot."""
    left, right = canvas.subplots(1, 2, width_ratios=(1.15, 1))
    rival = 1e3 * next(iter(exams.values()))[0].kinematic.position.mean()
    runs = [(label, one.training) for label, one in policies.items()]
    curves(left, runs, rival)
    rows = np.arange(len(losses))[::-1]
    for row, loss in zip(rows, losses.values(), strict=True):
        told = loss.as_dict()
        for shift, key, colour in ((0.18, "known_m", MEASURED), (-0.18, "hidden_m", INK)):
            value, (low, high) = told[key]["value"], told[key]["ci95"]
            right.barh(row + shift, 1e3 * value, 0.32, color=colour)
            right.plot([1e3 * low, 1e3 * high], [row + shift] * 2, color="#b0b6be", linewidth=1.2)
    right.set_yticks(rows, [label.replace(", ", "\n") for label in losses])
    right.set_xlabel("position error, mm")
    right.grid(visible=False, axis="y")
    for name, colour in (("known robots", MEASURED), ("hidden robot", INK)):
        right.barh(np.nan, np.nan, color=colour, label=name)
    right.legend(loc="lower right")
    canvas.tight_layout()
