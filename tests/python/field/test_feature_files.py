"""Files of features of another network: read whole or refused, also while somebody writes them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from dfd.field.given_features import read_features

WRITTEN_MEANWHILE = """
import sys, threading, time
from pathlib import Path
import numpy as np
from dfd.field.given_features import read_features

path = Path(sys.argv[1])
arrays = [np.full((rows, 64), rows, np.float32) for rows in (3_000, 60_000)]
np.save(path, arrays[0])
done = threading.Event()

def write():
    while not done.is_set():
        for array in arrays:
            np.save(path, array)

writer = threading.Thread(target=write)
writer.start()
end = time.monotonic() + 1.5
while time.monotonic() < end:
    try:
        assert read_features(path, "`features`").shape in [(3_000, 64), (60_000, 64)]
    except ValueError as error:
        assert str(error).startswith("`features` must be an .npy file of numbers, but "), error
done.set()
writer.join()
print(read_features(path, "`features`").shape)
"""


def test_a_file_that_is_written_anew_meanwhile_is_read_or_refused(tmp_path: Path) -> None:
    arguments = [sys.executable, "-c", WRITTEN_MEANWHILE, str(tmp_path / "features.npy")]
    done = subprocess.run(arguments, capture_output=True, text=True, timeout=120, check=False)
    assert (done.returncode, done.stdout) == (0, "(60000, 64)\n"), done.stderr


@pytest.mark.parametrize("shape", [(10**10, 2400), (1000, 384), (-1, 4)])
def test_a_header_that_promises_more_than_there_is_is_refused(shape: tuple[int, int], tmp_path: Path) -> None:
    path = tmp_path / "features.npy"
    with path.open("wb") as stream:
        np.lib.format.write_array_header_1_0(stream, {"descr": "<f4", "fortran_order": False, "shape": shape})
        stream.write(bytes(100))
    with pytest.raises(ValueError, match=r"^`features` must be an .npy file of numbers, but .*features.npy is not: "):
        read_features(path, "`features`")
