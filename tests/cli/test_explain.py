import json

from whid.errors import CATALOGUE


def test_one_code(whid):
    found = whid("explain", "config-unknown")
    assert found.exit_code == 0
    assert found.stdout.splitlines()[1] == f"try: {CATALOGUE['config-unknown'].remedy}"


def test_all_codes_and_the_exit_codes(whid):
    errors, exits = json.loads(whid("explain", "--json").stdout)
    assert {row["code"] for row in errors["rows"]} == set(CATALOGUE)
    assert [row["exit"] for row in exits["rows"]] == [0, 1, 2, 3, 4, 5, 130]


def test_a_code_that_is_not_there(whid):
    found = whid("explain", "config-unknwon")
    assert found.exit_code == 2
    assert "did you mean config-unknown?" in found.stderr
