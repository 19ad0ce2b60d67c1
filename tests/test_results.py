"""Results in a console and a notebook, and arguments given as files, names or objects alike."""

import json
import re

import pytest
from matplotlib.figure import Figure

from ident import Log, calibrate_kinematics, compare, design_motion, diagnose, identify, improve
from youbot_env.model_file import load_model

FIT, TEST = "youbot_fit", "youbot_test"


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Two files with parts of the bundled logs."""
    folder = tmp_path_factory.mktemp("logs")
    parts = {"fit": Log.load(FIT).part(0.0, 60.0), "test": Log.load(TEST).part(0.0, 15.0)}
    return {name: log.save(folder / f"{name}.csv") for name, log in parts.items()}


@pytest.fixture(scope="module")
def results(files):
    """One result of every function of the library, all from files and names."""
    improved = improve([files["fit"]], load_model("nominal"))
    return {
        "identify": identify(files["fit"], "nominal", test=files["test"]),
        "compare": compare(files["test"], ["nominal", "paper"]),
        "one": compare(str(files["test"]), "nominal")[0],
        "diagnose": improved.found,
        "improve": improved,
        "calibrate": calibrate_kinematics(files["fit"]),
        "design": design_motion("m0", "paper", seconds=40.0, harmonics=3, starts=1),
    }


NAMES = ("identify", "compare", "one", "diagnose", "improve", "calibrate", "design")


@pytest.mark.parametrize("name", NAMES)
def test_a_result_prints_itself_in_some_lines(results, name):
    text = repr(results[name])
    assert results[name].headline() in text
    assert len(text) < 6_000
    head = text.splitlines()[1].split("  ")[0]
    assert head == next(iter(results[name].table()), "")


@pytest.mark.parametrize("name", NAMES)
def test_a_result_is_a_table(results, name):
    columns = results[name].table()
    frame = results[name].to_polars()
    assert frame.columns == list(columns)
    assert frame.height == len(next(iter(columns.values()), ()))
    page = results[name]._repr_html_()
    assert page.count("<tr>") == 1 + min(frame.height, 24)
    assert not re.search(r"<(?!/?(p|b|table|thead|tbody|tr|th|td)>)", page)


@pytest.mark.parametrize("name", NAMES)
def test_a_result_is_written_and_drawn(results, name):
    json.dumps(results[name].to_dict(), default=float)
    picture = results[name].plot()
    assert isinstance(picture, Figure)
    assert picture.axes


def test_names_files_and_objects_answer_alike(files):
    log, model = Log.load(files["test"]), load_model("nominal")
    (one,), (same,) = compare(log, [model]), compare(files["test"], "nominal")
    assert one.run.nrmse == same.run.nrmse
    assert one.model == same.model


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda log: compare(log, []), "models is empty"),
        (lambda log: compare(log, 3), "model = 3"),
        (lambda log: identify(3), "log = 3"),
        (lambda log: identify([log, None]), "log = None"),
        (lambda log: diagnose("nowhere.csv"), "nowhere.csv"),
        (lambda log: compare(log, "paperr"), "paperr"),
    ],
)
def test_a_wrong_argument_is_named(files, call, words):
    with pytest.raises((TypeError, ValueError, OSError), match=words):
        call(files["test"])
