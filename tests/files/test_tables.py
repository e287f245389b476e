"""Readers against files written by the libraries that define the formats."""

import gzip

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from whid.errors import WhidError
from whid.files.table import open_table

T, U, Y = np.arange(50) * 0.1, np.sin(np.arange(50)), np.cos(np.arange(50))


def columns(path, *names, **text):
    table = open_table(path, **text)
    return table, table.load([table.find(name) for name in names])


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_text_encodings_and_line_ends(tmp_path, encoding, end):
    path = tmp_path / "a.csv"
    rows = ["t,Stellgröße,y"] + [f"{t!r},{u!r},{y!r}" for t, u, y in zip(T.tolist(), U.tolist(), Y.tolist(), strict=True)]
    path.write_bytes(end.join(rows).encode(encoding))
    table, (t, u, y) = columns(path, "t", "Stellgröße", "y")
    np.testing.assert_array_equal([t, u, y], [T, U, Y])  # repr round-trips to the last bit
    assert table.where(0) == "a.csv:2"


def test_gzip_and_decimal_comma(tmp_path):
    path = tmp_path / "a.csv.gz"
    with gzip.open(path, "wt") as file:
        file.write("t;u\n" + "".join(f"{t:.6f};{u:.6f}\n".replace(".", ",") for t, u in zip(T, U, strict=True)))
    np.testing.assert_allclose(columns(path, "u")[1][0], U, atol=5e-7)


def test_rows_are_counted_as_an_editor_does(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("# title\nt,u\n0,1\n\n1,2\n\n\n2,3\n3,oops\n4,5\n")
    table = open_table(path)
    with pytest.raises(WhidError, match=r"a\.csv:9: column u: 'oops' is not a number"):
        table.load([0, 1])
    path.write_text("# title\nt,u\n0,1\n\n1,2\n\n\n2,3\n3,4\n")
    table = open_table(path)
    table.load([0, 1])
    assert [table.where(k) for k in range(4)] == ["a.csv:3", "a.csv:5", "a.csv:8", "a.csv:9"]


def test_rows_beyond_the_first_chunk(tmp_path):
    path = tmp_path / "a.csv"
    rows = [f"{k},{k}" for k in range(250_000)]
    rows[230_000] = "230000,1,2"
    path.write_text("t,u\n" + "\n".join(rows))
    with pytest.raises(WhidError, match=r"a\.csv:230002: 3 cells, not 2"):
        open_table(path).load([0, 1])
    rows[230_000] = "230000,"
    path.write_text("t,u\n" + "\n".join(rows))
    (u,) = open_table(path).load([1])
    assert np.flatnonzero(np.isnan(u)).tolist() == [230_000]
    assert u[-1] == 249_999


def test_npz_vectors_matrices_scalars_and_objects(tmp_path):
    path = tmp_path / "a.npz"
    np.savez(path, u=U, y=Y[:, None], both=np.stack([U, Y]), fs=10.0, who=np.array(["me"]), bad=np.array([{}], object))
    table, (u, y, second) = columns(path, "u", "y", "both.1")
    np.testing.assert_array_equal([u, y, second], [U, Y, Y])
    assert table.names == ("u", "y", "both.0", "both.1")
    assert table.scalars == {"fs": 10.0}
    assert table.where(7) == "a.npz: sample 7"


def test_mat_with_a_struct(tmp_path):
    path = tmp_path / "a.mat"
    savemat(path, {"data": {"u": U, "y": Y[:, None]}, "Ts": 0.1, "text": "words"})
    table, (u, y) = columns(path, "data.u", "data.y")
    np.testing.assert_array_equal([u, y], [U, Y])
    assert table.scalars == {"Ts": 0.1}
    assert (table.guess("input"), table.guess("output")) == (0, 1)


def test_hdf5_paths_units_and_matlab_7_3(tmp_path):
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["bench/u"] = U
        file["bench/u"].attrs["units"] = "V"
        file["bench/y"] = Y[None]
        file["rate"] = 10.0
    table, (u, y) = columns(path, "bench/u", "bench/y")
    np.testing.assert_array_equal([u, y], [U, Y])
    assert (table.units, table.scalars) == ({"bench/u": "V"}, {"rate": 10.0})
    newer = tmp_path / "b.mat"
    with h5py.File(newer, "w", userblock_size=512) as file:
        file["u"] = U[None]
        file["name"] = np.frombuffer(b"hello", np.uint8).astype(np.uint16)
        file["name"].attrs["MATLAB_class"] = np.bytes_("char")
    with newer.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file".ljust(128))
    assert open_table(newer).names == ("u",)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.csv", b"", "is empty"),
        ("a.csv", b"\n\n  \n", "is empty"),
        ("a.csv", b"a,b\nc,d\n", "no row of numbers"),
        ("a.csv", b"1,2\0\n", "not text"),
        ("a.csv.gz", b"no gzip", "damaged.*Not a gzipped file"),
        ("a.npz", b"no zip", "pickle"),
        ("a.mat", b"no mat", "mat"),
        ("a.h5", b"no hdf5", "damaged.*file signature not found"),
        ("a.xlsx", b"PK", "no reader"),
        ("a.npz.gz", b"PK", "no reader"),
    ],
)
def test_damaged_files_have_a_name(tmp_path, name, content, message):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(WhidError, match=message) as fault:
        open_table(path).load([0])
    assert fault.value.code == "data-unreadable"
    assert name in str(fault.value)


def test_did_you_mean(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("time,voltage,speed\n0,1,2\n1,2,3\n")
    table = open_table(path)
    assert table.find("Voltage") == table.find("voltage [V]") == table.find(1) == 1
    with pytest.raises(WhidError, match="did you mean 'voltage'"):
        table.find("voltag")
    with pytest.raises(WhidError, match="the file has 3"):
        table.find(3)
