"""What is taken for a config."""

import pytest

from whid.errors import WhidError
from whid.files.text import read_text


def test_a_data_file_is_answered_with_the_command_that_reads_it():
    with pytest.raises(WhidError, match=r"whid ingest bench\.csv"):
        read_text("bench.csv")
