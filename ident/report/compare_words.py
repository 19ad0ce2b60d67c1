"""A comparison in a sentence and in rows, for terminal and page alike."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.comparison import Beside, Comparison, Regime, Standing
from ident.log import Log
from ident.report.outcome import percent, rounded

NAMED = 2  # regimes named in the verdict


def verdict(standings: list[Standing]) -> str:
    """Which model is best and where it fails."""
    best, others = standings[0], standings[1:]
    name, log = best.comparison.model.name, best.comparison.log.name
    error = percent(best.comparison.run.nrmse)
    if not np.isfinite(best.comparison.run.nrmse):
        return f"No model predicts {log}: every simulation grows without bound."
    equal = [s for s in others if s.ci95 is not None and not s.worse]
    if not others:
        sentence = f"{name} predicts {log} with a free-run error of {error}"
    elif equal:
        names = [name, *(s.comparison.model.name for s in equal)]
        sentence = (
            f"{', '.join(names[:-1])} and {names[-1]} predict {log} alike within chance, "
            f"free-run error of {name} {error}"
        )
    else:
        rest = ", ".join(
            f"{s.comparison.model.name} {percent(s.comparison.run.nrmse)}" for s in others[:3]
        )
        sentence = f"{name} predicts {log} best: free-run error {error} ({rest})"
        if others[0].ci95 is None and np.isfinite(others[0].ratio):
            sentence += ", in too few windows to rule out chance"
    where = ", ".join(regime.name for regime in gathering(best.comparison))
    return f"{sentence}." + (f" Where {name} fails most: {where}." if where else "")


def gathering(comparison: Comparison) -> list[Regime]:
    """The first regimes in which the error surely gathers, one of a kind; the body's first."""
    chosen: dict[str, Regime] = {}
    for regime in sorted(comparison.where, key=lambda regime: regime.of != "all"):
        if regime.flagged:
            chosen.setdefault(regime.kind, regime)
    return list(chosen.values())[:NAMED]


def failing(comparison: Comparison) -> str:
    """Where the error of a model gathers, in a sentence with figures."""
    name = comparison.model.name
    chosen = gathering(comparison)
    if not chosen:
        return f"The equation error of {name} gathers nowhere by more than chance."
    parts = []
    for r in chosen:
        owner = "" if r.of == "all" else f" of {r.of}"
        time = "" if r.kind in ("axis", "wheel") else f" in {percent(r.share_of_time)} of the time"
        parts.append(f"{r.name}, {percent(r.share_of_error)} of it{owner}{time}")
    return f"The equation error of {name} gathers: {'; '.join(parts)}."


def note(log: Log) -> str:
    """What to know about a log before its errors are read; empty for a log of torques."""
    if log.drive == "torque":
        return ""
    return (
        f"{log.name} is driven by voltage. A model in N m (data sheet, paper) is then wrong by the "
        "torque per volt and lacks the back-EMF; compare models identified from logs of this "
        "drive (youbot identify LOG --out MODEL.yaml)."
    )


FREE_RUN_HEAD = (
    "model", "vx m/s", "vy m/s", "yaw rad/s", "vx %", "vy %", "yaw %", "all %", "95 % interval",
    "times the best",
)  # fmt: skip


def free_run_rows(standings: list[Standing]) -> list[tuple[str, ...]]:
    """Free-run errors by axis in physical units and as shares, all axes, beside the best model."""
    rows = []
    for standing in standings:
        c = standing.comparison
        span, beside = "-", "-"
        if c.run_ci95 is not None:
            span = " ... ".join(share(end) for end in c.run_ci95)
        if standing.ci95 is not None:
            beside = "{:.3g} ({:.3g} ... {:.3g})".format(standing.ratio, *standing.ci95)
        rows.append(
            (
                c.model.name,
                *(rounded(v, v) for v in c.run.rmse),
                *(share(v) for v in c.run_nrmse),
                share(c.run.nrmse),
                span,
                beside,
            )
        )
    return rows


def equation_head(log_units: tuple[str, str, str]) -> tuple[str, ...]:
    """Head of ``equation_rows``."""
    forces = (f"{name} {unit}" for name, unit in zip(("F_X", "F_Y", "M_O"), log_units, strict=True))
    return ("model", *forces, "X %", "Y %", "yaw %", "all %")


def equation_rows(standings: list[Standing]) -> list[tuple[str, ...]]:
    """Equation errors by axis in physical units and as shares, and over all axes."""
    return [
        (
            s.comparison.model.name,
            *(rounded(v, v) for v in s.comparison.force_rmse),
            *(share(v) for v in s.comparison.equation),
        )
        for s in standings
    ]


WHERE_HEAD = ("regime", "of error %", "95 %", "of time %", "excess", "p adjusted", "significant")


def where_rows(where: tuple[Regime, ...], most: int) -> list[tuple[str, ...]]:
    """The first regimes: share of error with interval, share of time, their ratio, significance."""
    return [
        (
            r.name,
            f"{100 * r.share_of_error:.0f}",
            f"{100 * r.ci95[0]:.0f} ... {100 * r.ci95[1]:.0f}",
            f"{100 * r.share_of_time:.0f}",
            f"{r.excess:.2f}",
            probability(r.p_adjusted),
            "yes" if r.flagged else "",
        )
        for r in where[:most]
    ]


def harmonic_rows(comparison: Comparison, most: int) -> list[tuple[str, ...]]:
    """The first harmonics: wheel, order, amplitude with interval, significance."""
    return [
        (
            f"{h.wheel}, order {h.order}",
            f"{h.amplitude:.2g}",
            f"{h.ci95[0]:.2g} ... {h.ci95[1]:.2g}",
            probability(h.p_adjusted),
            "yes" if h.flagged else "",
        )
        for h in comparison.ripple[:most]
    ]


def stretch_rows(comparison: Comparison) -> list[tuple[str, ...]]:
    """The worst windows: number, time, errors by axis, share of all error."""
    return [
        (
            f"{number}",
            f"{s.start:.1f} ... {s.end:.1f}",
            *(rounded(v, v) for v in s.rmse),
            share(s.nrmse),
            share(s.share_of_error),
        )
        for number, s in enumerate(comparison.worst, start=1)
    ]


def share(value: float) -> str:
    """A share in percent without the sign, for columns that carry it in their head."""
    return percent(float(value)).removesuffix(" %")


def probability(p: float) -> str:
    """A p value: small ones by their order of magnitude."""
    return f"{p:.2g}" if p >= 1e-4 else f"1e{int(np.ceil(np.log10(max(p, 1e-300))))}"


BESIDE = "Free run on the logs that do not judge, and on those that do"


def beside_table(
    standings: Sequence[Standing], fitted: Beside
) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Head and rows of the errors on fitted logs, beside those on the logs that judge."""
    judging = standings[0].comparison.log.name
    head = ("model", f"{fitted.log} all %", f"{judging} (--test) all %")
    on = {row[0]: row[7] for row in free_run_rows(standings)}
    return head, [(name, share(error), on[name]) for name, error in fitted.errors.items()]
