"""Where a data file is looked for."""

import pytest

from whid.errors import WhidError
from whid.files.source import locate


def test_beside_the_config_first_then_under_whid_data(tmp_path, monkeypatch):
    beside, data = tmp_path / "study", tmp_path / "data"
    beside.mkdir()
    data.mkdir()
    monkeypatch.setenv("WHID_DATA", str(data))
    (data / "a.csv").write_text("x")
    assert locate("a.csv", beside) == data / "a.csv"
    (beside / "a.csv").write_text("x")
    assert locate("a.csv", beside) == beside / "a.csv"
    assert locate(str(data / "a.csv"), beside) == data / "a.csv"
    with pytest.raises(WhidError, match=r"b\.csv") as fault:
        locate("b.csv", beside)
    assert fault.value.code == "data-file"
