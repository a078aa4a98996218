"""Check how a command ended, and read the picture that it drew."""

import numpy as np
from PIL import Image


def failed(result, message, code=2):
    """Assert that a run ended with one line on standard error that contains `message`."""
    assert result.exit_code == code, result.output
    assert result.stdout == ""
    lines = [line for line in result.stderr.splitlines() if "━" not in line]  # without progress bars
    assert len(lines) == 1, lines
    assert lines[0].startswith("dfd: ")
    assert message in lines[0]
    return True


def worked(result):
    assert result.exit_code == 0, (result.output, result.exception)
    return True


def drawn(path):
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB")).astype(int)
