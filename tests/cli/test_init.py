from pathlib import Path

CONFIGS = Path(__file__).parents[2] / "configs"


def test_the_starter_is_written_and_is_a_study(whid, tmp_path):
    found = whid("init")
    assert found.exit_code == 0
    assert "whid run study.yaml" in found.stdout
    text = (tmp_path / "study.yaml").read_text("utf-8")
    assert text == (CONFIGS / "starter.yaml").read_text("utf-8")
    assert (tmp_path / text.partition("$schema=")[2].partition("\n")[0]).is_file()  # what the header names is there
    assert whid("check", "study.yaml").exit_code == 0


def test_nothing_is_overwritten(whid, tmp_path):
    (tmp_path / "mine.yaml").write_text("mine")
    found = whid("init", "mine.yaml")
    assert found.exit_code == 2
    assert "error[file-exists]: mine.yaml: exists already" in found.stderr
    assert (tmp_path / "mine.yaml").read_text() == "mine"


def test_a_second_starter_keeps_the_schema_that_is_there(whid, tmp_path):
    (tmp_path / "whid.schema.json").write_text("{}")
    assert whid("init", "a.yaml").exit_code == 0
    assert (tmp_path / "whid.schema.json").read_text() == "{}"


def test_a_folder_that_is_not_there(whid):
    found = whid("init", "no/such/folder.yaml")
    assert found.exit_code == 3
    assert "error[file-access]" in found.stderr
