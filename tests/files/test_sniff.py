"""Text tables as instruments and spreadsheets write them."""

import pytest

from whid.errors import WhidError
from whid.files.sniff import number, sniff, split

TABLES = {
    "comma": (["t,u,y", "0,1.5,2", "1,1.5,3"], ",", ".", 1, ("t", "u", "y")),
    "semicolon, decimal comma": (["t;u;y", "0,0;1,5;2,25", "0,1;1,5;3,5"], ";", ",", 1, ("t", "u", "y")),
    "decimal comma in one column only": (["t;u;y", "0;1;2,5", "1;1;3,5"], ";", ",", 1, ("t", "u", "y")),
    "tab": (["t\tu\ty", "0\t1e-3\t-2.5", "1\t2e-3\t3"], "\t", ".", 1, ("t", "u", "y")),
    "tab, decimal comma": (["0\t1,5\t2", "1\t1,5\t3"], "\t", ",", 0, ("0", "1", "2")),
    "blanks": (["  0   1.5  2", " 10   1.5 -3"], " ", ".", 0, ("0", "1", "2")),
    "blanks, decimal comma": (["0 1,5 2,5", "1 1,5 3,5"], " ", ",", 0, ("0", "1", "2")),
    "comma and blank": (["t, u, y", "0, 1.5, 2", "1, 1.5, 3"], ",", ".", 1, ("t", "u", "y")),
    "comment header": (["# bench 7, 2024", "# t u y", "0 1 2", "1 1 3"], " ", ".", 2, ("t", "u", "y")),
    "preamble with numbers": (["Rate,100", "Gain,2", "t,u,y", "0,1,2", "1,1,3", "2,1,3"], ",", ".", 3, ("t", "u", "y")),
    "blank line before the data": (["t,u,y", "", "0,1,2", "1,1,3"], ",", ".", 2, ("t", "u", "y")),
    "quoted": (['"t","u","y"', '"0","1.5","2"', '"1","1.5","3"'], ",", ".", 1, ("t", "u", "y")),
    "trailing delimiter": (["t,u,y,", "0,1,2,", "1,1,3,"], ",", ".", 1, ("t", "u", "y")),
    "trailing delimiter in the data only": (["t;u;y", "0;1;2;", "1;1;3;"], ";", ".", 1, ("t", "u", "y")),
    "missing cells": (["t,u,y", "0,1,2", "1,,3", "2,1,NaN", "3,1,"], ",", ".", 1, ("t", "u", "y")),
    "a column of words": (["t,state,y", "0,on,2", "1,off,3"], ",", ".", 1, ("t", "state", "y")),
    "windows line ends": (["t,u\r\n", "0,1\r\n", "1,2\r\n"], ",", ".", 1, ("t", "u")),
    "same heading twice": (["t,u,u", "0,1,2", "1,1,3"], ",", ".", 1, ("t", "u.1", "u.2")),
}


@pytest.mark.parametrize("name", TABLES)
def test_dialects(name):
    lines, delimiter, decimal, first, names = TABLES[name]
    found = sniff(lines)
    assert (found.delimiter, found.decimal, found.first, found.names) == (delimiter, decimal, first, names)


def test_units_in_headings_and_in_a_row_of_their_own():
    assert sniff(["Time [ms],u (V),y", "0,1,2", "1,1,3"]).units == {"Time": "ms", "u": "V"}
    own = sniff(["Time,u,y", "s,V,m/s", "0,1,2", "1,1,3"])
    assert (own.names, own.units) == (("Time", "u", "y"), {"Time": "s", "u": "V", "y": "m/s"})


def test_given_options_win():
    assert sniff(["1,5;2", "2,5;3"], delimiter=",").delimiter == ","
    assert sniff(["9,9", "t,u", "0,1", "1,2"], header_lines=2).first == 2
    with pytest.raises(WhidError, match="no row of numbers"):
        sniff(["a,b", "c,d"])


def test_cells():
    assert split('"a,b", c ,""', ",") == ["a,b", "c", ""]
    assert number("1e-3", ".") == 1e-3
    assert number("1.5", ",") is None
    assert number("0x10", ".") is None


def test_headings_stand_near_the_data_and_a_unit_in_brackets_belongs_to_its_heading():
    preamble = ["# rig 7, Tuesday", "# operator: J.", "% fs=20 Hz", "", "time [s]  valve (V)  flow [l/min]"]
    found = sniff([*preamble, "0.00  1.0  2.0", "0.05  1.0  2.5"])
    assert (found.names, found.units) == (("time", "valve", "flow"), {"time": "s", "valve": "V", "flow": "l/min"})
    assert not sniff(["rig 7, Tuesday", "one", "two", "three", "0 1 2", "1 1 3"]).named
