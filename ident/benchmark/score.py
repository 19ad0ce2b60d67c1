"""What one answer is worth: was something named, was it right, did it help.

Groups that hold what was done to the recording, and in answers about robots with real rollers names
of what these are known to bring (ripple, slip), count neither for nor against.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import null_space

from ident.benchmark.hidden import named as effect_of
from ident.benchmark.laws import OtherLaw
from youbot_env.effects import effect_names, get_effect
from youbot_env.platform import youbot

ROLLING = ("roller_ripple", "wheel_slip")


@dataclass(frozen=True)
class Score:
    """One answer compared with the truth.

    Attributes:
        verdict: of the answer.
        names: effects named, first of each group, in the order added.
        hidden: what is hidden.
        exact: every hidden effect is a first name, and there is no other.
        first: the first name is a hidden effect (or, for a law outside the library, a relative).
        group: the first group holds a hidden effect, or its name is listed as looking like one.
        holds: the first group holds a hidden effect.
        all_held: every hidden effect is in a group of its own.
        wrong: a name that is neither hidden nor listed as looking like what is hidden.
        extra: more names than hidden effects.
        size: number of effects in the first group; 0 where nothing is named.
        covered: of each named parameter whose truth is comparable, whether its interval holds it.
        fell: whether the verifying free-run error fell; None where nothing is named.
        closed: share of the gap to the true model's error that the answer closed, or None.
    """

    verdict: str
    names: tuple[str, ...]
    hidden: tuple[str, ...]
    exact: bool
    first: bool
    group: bool
    holds: bool
    all_held: bool
    wrong: bool
    extra: bool
    size: int
    covered: dict[str, bool]
    fell: bool | None
    closed: float | None


def score(record: dict[str, Any], at_last: bool = False) -> Score:
    """Score one stored record (see ``runner.examine``).

    Args:
        record: the record.
        at_last: whether the answer after the experiment counts, where there was one.
    """
    answer, hidden = record["answer"], tuple(record["hidden"])
    if at_last and record.get("followed"):
        answer = record["followed"]
    rolling = ROLLING if record["part"] == "rollers" else ()
    steps = [step for step in answer["named"] if step["effect"] not in rolling]
    names = tuple(step["effect"] for step in steps)
    groups = [set(step["group"]) | {step["effect"]} for step in steps]
    accepted = [meant(identifier) for identifier in hidden]
    alike = set().union(*(lookalikes(identifier) for identifier in hidden))
    meant_by_any = set().union(*accepted)
    # A group that holds what is wrong with the recording is a right answer about that.
    fault = set((record.get("conditions", {}).get("fault") or ())[:1])
    told = [k for k, group in enumerate(groups) if group & fault]
    names, groups = ([x for k, x in enumerate(some) if k not in told] for some in (names, groups))
    steps, names = [step for k, step in enumerate(steps) if k not in told], tuple(names)
    right = [bool(g & meant_by_any) or n in alike for n, g in zip(names, groups, strict=True)]
    exact = len(names) == len(hidden) and all(set(names) & wanted for wanted in accepted)
    before, after = (answer.get("free_run", {}).get(k) for k in ("before", "after"))
    judged = bool(names) and before is not None and after is not None
    return Score(
        verdict=answer["verdict"],
        names=names,
        hidden=hidden,
        exact=exact and bool(names),
        first=bool(names) and names[0] in meant_by_any,
        group=bool(names) and right[0],
        holds=bool(names) and bool(groups[0] & meant_by_any),
        all_held=bool(hidden) and _matched(accepted, groups),
        wrong=not all(right),
        extra=len(names) > len(hidden),
        size=len(groups[0]) if groups else 0,
        covered=coverage(record, steps[0]) if exact and len(hidden) == 1 else {},
        fell=after < before if judged else None,
        closed=_closed(record, before, after) if judged else None,
    )


def meant(identifier: str) -> set[str]:
    """Library names that are right for a hidden effect; none for what is outside the library."""
    effect = effect_of(identifier)
    if isinstance(effect, OtherLaw):
        return set(effect.relatives)
    return {identifier} & set(effect_names())


def lookalikes(identifier: str) -> set[str]:
    """Effects that the library itself lists as looking like a hidden one."""
    return set().union(*(get_effect(name).confusables for name in meant(identifier)))


def coverage(record: dict[str, Any], step: dict[str, Any]) -> dict[str, bool]:
    """Whether the 95 % interval of each linear parameter holds the truth.

    Left out are parameters without an interval, and those of an effect that was found with
    another arrangement of wheels than it was hidden with: there is then no common truth.
    """
    effect = step["effect"]
    truth = record["truth"].get(effect)
    if truth is None:
        return {}
    truth, sizes = visible(effect, truth), step["size"]
    found = {}
    for name, quantity in sizes.items():
        parameter = get_effect(effect).parameter_of(name)
        true = truth.get(name, truth.get(parameter.name))
        if quantity.get("ci95") is None or true is None or not parameter.linear:
            continue
        low, high = quantity["ci95"]
        found[name] = bool(low <= true <= high)
    return found


def visible(effect: str, truth: dict[str, float]) -> dict[str, float]:
    """Truth as a record can show it.

    Of contrasts only the differences between wheels show: the common part belongs to a parameter of
    the robot, or (of torque constants) to the invisible scale of all torques.  Offsets in the
    direction of torques that move nothing do not show either.
    """
    seen = dict(truth)
    for parameter in get_effect(effect).parameters:
        names = [n for n in truth if n.startswith(f"{parameter.name}_")]
        if not parameter.per_wheel or len(names) < 2:
            continue
        values = np.array([truth[name] for name in names])
        if effect == "torque_gain":
            values = (1.0 + values) / (1.0 + values.mean()) - 1.0
        elif parameter.contrast:
            values = values - values.mean()
        if effect == "torque_offset":
            still = null_space(youbot().jacobian_array.T)
            values = values - still @ (still.T @ values)
        seen |= dict(zip(names, values.tolist(), strict=True))
    return seen


def _matched(accepted: list[set[str]], groups: list[set[str]]) -> bool:
    """Tell whether each hidden effect has a group of its own (of two effects at most)."""
    if len(accepted) == 1:
        return any(group & accepted[0] for group in groups)
    pairs = [(a, b) for a in range(len(groups)) for b in range(len(groups)) if a != b]
    return any(accepted[0] & groups[a] and accepted[1] & groups[b] for a, b in pairs)


def _closed(record: dict[str, Any], before: float, after: float) -> float | None:
    oracle = record.get("oracle")
    if oracle is None or before <= oracle:
        return None
    return (before - after) / (before - oracle)
