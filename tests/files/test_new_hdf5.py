"""A full disk while a result is written: a named fault, never the end of the process."""

import resource
import subprocess
import sys
import textwrap

import h5py
import numpy as np
import pytest

from whid.files._new_hdf5 import new_hdf5


@pytest.mark.parametrize("limit", [0, 2048])
def test_a_disk_that_is_full_is_an_oserror(tmp_path, limit):
    code = f"""
    import numpy as np
    from pathlib import Path
    from whid.files._new_hdf5 import new_hdf5
    try:
        with new_hdf5(Path("{tmp_path}") / "a.h5") as file:
            for k in range(20):
                file.create_dataset(f"d{{k}}", data=np.arange(100.0)).make_scale()
    except OSError as fault:
        print(fault.strerror)
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True, timeout=60,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (0, "File too large\n", "")


def test_what_is_written_is_there_and_space_for_much_is_looked_for_first(tmp_path):
    for size in (0, 1 << 26):
        with new_hdf5(tmp_path / f"{size}.h5", size) as file:
            file["x"] = np.arange(3)
        with h5py.File(tmp_path / f"{size}.h5") as file:
            assert file["x"][:].tolist() == [0, 1, 2]
    with pytest.raises(OSError, match="GB are free"), new_hdf5(tmp_path / "much.h5", 1 << 60):
        pass
    assert not (tmp_path / "much.h5").exists()
