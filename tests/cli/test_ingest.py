"""`whid ingest`: what it prints can be used as it is."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from whid.blocks.linear import Linear
from whid.cli.ingest import command
from whid.config.yaml import parse
from whid.errors import WhidError
from whid.kinds import plain


@pytest.fixture
def bench(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(1)
    u = np.repeat(np.concatenate([np.arange(-1, 1.1, 0.5), np.arange(0.5, -1.1, -0.5)]), 60)
    u = np.concatenate([u, 0.5 + 0.25 * np.cos(2 * np.pi * np.arange(600) / 60)])
    y = Linear(num=(1.0,), den=(0.5, 1.0))(u, 0.1) + 1e-3 * rng.standard_normal(len(u))
    rows = "".join(f"{0.1 * k:.1f},{a!r},{b!r}\n" for k, (a, b) in enumerate(zip(u.tolist(), y.tolist(), strict=True)))
    (tmp_path / "bench.csv").write_text("t,u [V],y [m/s]\n" + rows)
    return tmp_path


def run(*arguments):
    return CliRunner().invoke(command, list(arguments), catch_exceptions=False)


def test_shows_columns_parts_picture_and_a_block_that_loads(bench):
    out = run("bench.csv").output
    for words in (
        "bench.csv",
        "9 holds",
        "5 different, -1 … 1; each 6 s",
        "period 60 samples (6 s)",
        "10 Hz",
        "as declared",
    ):
        assert words in out
    assert (bench / "bench-ingest.png").read_bytes()[:4] == b"\x89PNG"
    block = parse(out.partition("# save as bench.yaml")[2].partition("\n")[2], "block").value["data"]
    assert plain(block)["columns"] == {"time": "t", "input": "u", "output": "y"}
    assert plain(block)["units"] == {"input": "V", "output": "m/s"}


def test_the_study_runs_as_it_is(bench):
    from pathlib import Path

    from whid.config.load import load_study
    from whid.files.ingest import ingest

    (bench / "study.yaml").write_text("# save as" + run("bench.csv").output.partition("# save as")[2])
    study = load_study(bench / "study.yaml")
    assert len(ingest(study.data, Path()).record.parts) == 10
    assert "9 holds" in run("study.yaml").output


def test_json_is_one_object_and_writes_no_picture(bench):
    found = json.loads(run("bench.csv", "--json").output)
    assert found["data"]["parts"] == "auto"
    assert [part["kind"] for part in found["parts"]] == ["hold"] * 9 + ["sine"]
    assert len(found["sha256"]) == 64
    assert not (bench / "bench-ingest.png").exists()
    assert (run("bench.csv", "--json", "--out", "here.png"), (bench / "here.png").exists())[1]


def test_columns_and_faults(bench):
    assert "9 holds" in run("bench.csv", "--columns", "time=0,input=1,output=2").output
    assert run("bench.csv", "--columns", "in=1").exit_code == 2
    with pytest.raises(WhidError, match="no column 'v'"):
        run("bench.csv", "--columns", "input=v,output=y")
    with pytest.raises(WhidError, match="cannot write"):
        run("bench.csv", "--out", "nowhere/here.png")


def test_a_column_name_may_hold_a_comma(bench):
    rows = (bench / "bench.csv").read_text().partition("\n")[2]
    (bench / "excel.csv").write_text('"Time, since start","Valve, left","Flow (l/min)"\n' + rows)
    out = run("excel.csv", "--columns", "time=Time, since start,input=Valve, left,output=Flow").output
    assert "9 holds" in out


def test_a_fault_about_columns_says_what_to_type_here(bench):
    (bench / "german.csv").write_text((bench / "bench.csv").read_text().replace("t,u [V],y [m/s]", "Zeit,Ventil,Durchfluss"))
    with pytest.raises(WhidError, match="which column is the input") as fault:
        run("german.csv")
    assert "--columns" in fault.value.remedy


def test_uneven_times_and_a_name_with_umlauts(bench):
    rows = [line.split(",", 1) for line in (bench / "bench.csv").read_text().splitlines()[1:]]
    uneven = "".join(f"{float(t) + 0.03 * (k % 2):.2f},{rest}\n" for k, (t, rest) in enumerate(rows))
    (bench / "Prüfstand Süß.csv").write_text("t,u,y\n" + uneven, encoding="utf-8")
    with pytest.raises(WhidError, match="jitter") as fault:
        run("Prüfstand Süß.csv")
    assert "`--resample` for `whid ingest`" in fault.value.remedy
    out = run("Prüfstand Süß.csv", "--resample", "--json").output
    assert json.loads(out)["data"]["operations"] == [{"kind": "resample", "input": "hold"}]
    assert "name: Prufstand-Suss\n" in run("Prüfstand Süß.csv", "--resample").output


def test_a_damaged_file_is_no_question_of_columns(bench):
    import gzip

    (bench / "cut.csv.gz").write_bytes(gzip.compress((bench / "bench.csv").read_bytes())[:2000])
    with pytest.raises(WhidError, match="damaged, or not what its name says: Compressed file ended") as fault:
        run("cut.csv.gz")
    assert fault.value.code == "data-unreadable"


def test_a_place_without_room_for_the_picture_costs_the_picture_only(bench, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("whid.plots._style.save", full)
    out = run("bench.csv").output
    assert "no picture: bench-ingest.png: No space left on device; give another place with --out" in out
    assert "identify: {kind: wiener_hammerstein}" in out


def test_without_levels_the_study_is_for_any_excitation(bench):
    u, e = np.random.default_rng(3).standard_normal((2, 500))
    rows = "".join(
        f"{k / 100},{a:.4f},{b:.4f}\n" for k, (a, b) in enumerate(zip(u, np.append(0, u[:-1]) + 0.1 * e, strict=True))
    )
    (bench / "noise.csv").write_text("t,u,y\n" + rows)
    assert "identify: {kind: parametric}" in run("noise.csv").output
