import json


def test_the_schema_is_json_and_nothing_else(whid):
    found = whid("schema")
    assert found.exit_code == 0
    schema = json.loads(found.stdout)
    assert schema["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    assert schema["$defs"]["DeadZone"]["required"] == ["kind", "low", "high"]
