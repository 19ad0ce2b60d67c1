"""A result replaces what the same command wrote; for the rest it takes --force."""

import json

import polars as pl
import pytest
from small_policies import policy

LOG = ("--seconds", "3", "--motion", "circle", "--out", "a.csv")


@pytest.fixture
def origins():
    from youbot_cli import origins

    return origins


def check(origins, path, command):
    origins.check_replaceable([path], command)


def test_a_record_of_other_settings_is_kept(script, tmp_path):
    assert script("record.py", *LOG)[0] == 0
    kept = (tmp_path / "a.csv").read_bytes()
    status, _, said = script("record.py", *LOG, "--seed", "1")
    assert status == 2
    assert "was written by 'python scripts/record.py" in said
    assert "--force" in said
    assert (tmp_path / "a.csv").read_bytes() == kept
    assert script("record.py", *LOG)[0] == 0  # the very same again
    assert (tmp_path / "a.csv").read_bytes() == kept
    assert script("record.py", *LOG, "--seed", "1", "--force")[0] == 0
    assert (tmp_path / "a.csv").read_bytes() != kept
    assert "--force" not in (tmp_path / "a.csv").read_text()


def test_a_log_that_hides_its_effects_is_kept(script):
    assert script("record.py", *LOG, "--hide")[0] == 0
    assert script("record.py", *LOG, "--hide")[0] == 2


def test_a_measured_log_is_kept(script, tmp_path):
    (tmp_path / "a.csv").write_text("time,wheel_velocity_fl\n0,0\n")
    status, _, said = script("record.py", *LOG)
    assert status == 2
    assert "does not say what wrote it" in said


MODEL = "name: a\nprovenance: {command: 'python scripts/%s.py a.csv'}\n"


@pytest.mark.parametrize(
    ("name", "text", "good"),
    [
        ("m.yaml", MODEL % "identify", True),
        ("m.yaml", MODEL % "improve", False),
        ("m.yaml", "name: by hand\n", False),
        ("m.yaml", "about: {provenance: {command: python scripts/identify.py x}}", True),
        ("m.yaml", "[" * 3000, False),
        ("r.json", '{"provenance": {"command": "python scripts/identify.py b.csv"}}', True),
        ("r.json", '{"provenance": ["python scripts/identify.py"]}', False),
        ("r.json", "[1, 2]", False),
        ("r.json", "[" * 100_000, False),
        ("m.posterior.csv", "m0,I0\n", False),
        ("a.csv", "# python scripts/identify.py now\n", True),
        ("a.csv", "# python scripts/identify.py before\n", False),
        ("a.csv", "# made: from x, SHA-256 0, by python scripts/identify.py now\n", True),
        ("a.txt", "notes", False),
        ("a.parquet", "no table", False),
    ],
)
def test_origins(origins, tmp_path, name, text, good):
    path = tmp_path / name
    path.write_text(text)
    if good:
        check(origins, path, "python scripts/identify.py now")
    else:
        with pytest.raises(ValueError, match="--force"):
            check(origins, path, "python scripts/identify.py now")


def test_draws_belong_to_the_model_beside_them(origins, tmp_path):
    draws = tmp_path / "m.posterior.csv"
    draws.write_text("m0,I0\n")
    (tmp_path / "m.yaml").write_text(MODEL % "identify")
    check(origins, draws, "python scripts/identify.py now")


def test_parquet_of_a_conversion(origins, tmp_path):
    path = tmp_path / "a.parquet"
    made = "from a.bag, SHA-256 0, by python scripts/convert.py a.bag"
    pl.DataFrame({"time": [0.0]}).write_parquet(path, metadata={"made": made})
    check(origins, path, "python scripts/convert.py a.bag")
    with pytest.raises(ValueError, match=r"a\.bag"):
        check(origins, path, "python scripts/convert.py b.bag")


def test_a_policy_is_kept_unless_the_same_training_goes_on(origins, tmp_path):
    command = "python scripts/train.py --steps 9 --seed 1"
    file = policy(training={"provenance": {"command": command}}).save(tmp_path / "p.json")
    for path in (file, file.with_suffix(".npz")):
        check(origins, path, command)
        check(origins, path, "python scripts/train.py --seed 1 --resume --steps 20")
        for other in ("--steps 8 --seed 1", "--steps 9 --seed 2 --resume"):
            with pytest.raises(ValueError, match="--force"):
                check(origins, path, f"python scripts/train.py {other}")


def test_the_state_of_a_training_is_kept(script, tmp_path):
    (tmp_path / "c").mkdir()
    (tmp_path / "c" / "checkpoint.pt").write_bytes(b"hours")
    status, _, said = script("train.py", "--checkpoints", "c")
    assert status == 2
    assert "--resume" in said
    assert (tmp_path / "c" / "checkpoint.pt").read_bytes() == b"hours"


def test_a_folder_with_pieces_of_a_run_that_was_stopped_is_gone_on_with(origins, tmp_path):
    page, pieces = tmp_path / "index.html", tmp_path / "pieces"
    pieces.mkdir()
    (pieces / "0.piece.json").write_text("{}")
    origins.check_replaceable([page], "python scripts/improve.py --report x")
    (pieces / "chess.txt").write_text("rook")
    with pytest.raises(ValueError, match=r"holds other things \(pieces\)"):
        origins.check_replaceable([page], "python scripts/improve.py --report x")


def test_a_page_takes_no_folder_that_holds_other_things(origins, tmp_path):
    page, result = tmp_path / "index.html", tmp_path / "m.yaml"
    command = "python scripts/identify.py a.csv --report x"
    origins.check_replaceable([page, result], command)
    result.write_text(MODEL % "identify")
    origins.check_replaceable([page, result], command)  # beside it stands its own model
    (tmp_path / "thesis.tex").write_text("\\begin")
    with pytest.raises(ValueError, match=r"holds other things \(thesis.tex\)"):
        origins.check_replaceable([page, result], command)
    page.write_text("<p>somebody's page</p>")
    with pytest.raises(ValueError, match="does not say what wrote it"):
        origins.check_replaceable([page, result], command)


def test_a_page_says_what_wrote_it(origins, tmp_path):
    from ident.report.page import Page

    command = "python scripts/identify.py 'a b.csv' --map \"x=y\" <&>"
    Page("t", "v", True, "l", [], [], {"command": command}).write(tmp_path)
    assert origins.origin(tmp_path / "index.html").command == command


def test_results_say_what_wrote_them(origins, tmp_path):
    from youbot_cli import console

    path = tmp_path / "r.json"
    console.write_json(path, {"provenance": console.provenance(0)})
    assert json.loads(path.read_text())["provenance"]["command"] == origins.origin(path).command
