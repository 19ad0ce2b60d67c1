"""A fixed number of cases of the fuzz; ``make fuzz N=20000`` runs more."""

import os
import time
from collections import Counter

import pytest
from fuzz.cases import FAULTS, OUTCOMES, WEIGHTS, Spoiled, draw, judge
from fuzz.originals import Original, originals
from fuzz.watch import run

# About 40 s of one core.
CASES = 1000


def test_whatever_is_wrong_with_a_file_is_told():
    cases = list(run(0, range(CASES)))
    assert [case.index for case in cases] == list(range(CASES))
    faults = [case for case in cases if case.outcome in FAULTS]
    assert not faults, "\n".join(
        f"python -m fuzz --replay {c.index}: {c.outcome} of {c.kind} {c.spoiled}" for c in faults
    )
    outcomes, kinds = (Counter(getattr(c, name) for c in cases) for name in ("outcome", "kind"))
    assert min(outcomes[name] for name in OUTCOMES) >= 10
    assert min(kinds[name] for name in WEIGHTS) >= 40


def test_a_case_is_the_same_everywhere(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    good, made_anew = originals(tmp_path / "a"), originals(tmp_path / "b")
    for index in range(100):
        first, again = draw(good, 5, index), draw(made_anew, 5, index)
        assert (first.files, first.steps) == (again.files, again.steps)
    assert draw(good, 5, 1).files != draw(good, 6, 1).files


def read(*answers):
    def reader(path):
        if isinstance(answers[0], BaseException):
            raise answers[0]
        return answers

    return Original("kind", {"a.csv": b"1"}, "a.csv", reader, {}, {"known"}, "good")


@pytest.mark.parametrize(
    ("reader", "outcome"),
    [
        (read(KeyError("a")), "traceback"),
        (read(ValueError("of a library: a.csv")), "traceback"),
        (read(MemoryError()), "memory"),
        (read(AssertionError("not finite")), "unsound"),
        (read("good", {"known"}), "same"),
        (read("good", {"known", "spikes"}), "told"),
        (read("other", {"known"}), "changed"),
    ],
)
def test_outcomes(tmp_path, reader, outcome):
    assert judge(Spoiled(reader, reader.files, ()), 0, tmp_path).outcome == outcome


def test_an_error_has_to_name_the_file(tmp_path):
    from youbot_env.model_file import load_model, model_from_dict

    named = Original("", {"mine.yaml": b"["}, "mine.yaml", lambda p: load_model(p), {}, set())
    assert judge(Spoiled(named, named.files, ()), 0, tmp_path).outcome == "refused"
    nameless = Original(
        "", {"mine.yaml": b"["}, "mine.yaml", lambda p: model_from_dict([]), {}, set()
    )
    assert judge(Spoiled(nameless, nameless.files, ()), 0, tmp_path).outcome == "nameless"


def bad_worker(pipe, seed, indices):
    """Hang in the first case, die in the second, as readers in other languages can."""
    pipe.send("ready")
    pipe.send(("CSV", ("mine.csv: file cut off",)))
    if indices[0] == 0:
        time.sleep(60)
    os._exit(9)


def test_what_hangs_or_dies_is_a_result():
    cases = list(run(0, [0, 1], bad_worker, hang=0.5))
    assert [case.outcome for case in cases] == ["hang", "died"]
    assert all(case.spoiled for case in cases)
