"""Two effects that are missing at once, where neither is seen without the other.

Alone each of two missing effects is judged by errors that the other one causes: its size comes out
wrong, and on another motion it may help nothing.  On inner products a pair costs no more than a
single effect, so all pairs are tried.
"""

from __future__ import annotations

import numpy as np

from ident.diagnosis.evidence import Evidence
from ident.diagnosis.shortlist import SLACK

# A pair must leave at most this share of what the best single effect leaves where it was not
# fitted, and neither half may be able to do without the other.
CLEARLY = 0.5
# Forms of each effect that are paired, and pairs that are judged where they were not fitted.
FORMS, JUDGED = 2, 40
# Squared error that one more coefficient must remove, as a share of what is left.
PRICE = 0.02


def best_pair(evidence: Evidence, alone: float) -> tuple[int, int] | None:
    """The two trials that explain the logs far better than any one.

    Args:
        evidence: about all trials.
        alone: share of the squared error that the best single effect removes where it was not
            fitted, 0 where none does.

    Returns:
        Trials, the one first that explains more by itself; None where no pair is that good.
    """
    found, best, judged = None, alone, set()
    for first, second in _promising(evidence):
        pair = frozenset((evidence.trials[first].identifier, evidence.trials[second].identifier))
        if len(judged | {pair}) > JUDGED:
            break
        judged.add(pair)
        gain = evidence.gain(second, beside=first)
        if gain > best and _sensible(evidence, first, second):
            found, best = (first, second), gain
    if found is None or 1.0 - best > CLEARLY * (1.0 - alone):
        return None
    return tuple(sorted(found, key=lambda k: -evidence.explained(k)))


def _promising(evidence: Evidence) -> list[tuple[int, int]]:
    """Pairs of trials by what they explain together where they are fitted, best first."""
    count = len(evidence.trials)
    alone = np.array([evidence.explained(k) for k in range(count)])
    sizes = np.array([len(columns) for columns in evidence.columns[:count]])
    starts, seen = [], {}
    for k in np.argsort(-alone):
        name = evidence.trials[k].identifier
        seen[name] = seen.get(name, 0) + 1
        if seen[name] <= FORMS and not evidence.trials[k].effect.background:
            starts.append(int(k))
    pairs = []
    for first in starts:
        effect = evidence.trials[first].identifier
        for second in range(count):
            trial = evidence.trials[second]
            if trial.identifier == effect or trial.effect.background:
                continue
            # Coefficients that must stay near one are those of the second.
            if trial.linear <= evidence.trials[first].linear:
                left = 1.0 - evidence.explained(second, beside=first)
                pairs.append((left * (1 + PRICE * (sizes[first] + sizes[second])), first, second))
    return [(first, second) for _, first, second in sorted(pairs)]


def _sensible(evidence: Evidence, *pair: int) -> bool:
    return all(
        evidence.trials[one].possible(evidence.coefficients(one, beside=other), SLACK)
        for one, other in (pair, pair[::-1])
    )
