"""How a command ended, and what it drew."""

import numpy as np
from PIL import Image


def failed(result, message, code=2):
    """Assert that a run ended with one line on standard error that holds `message`."""
    assert result.exit_code == code, result.output
    assert result.stdout == ""
    lines = [line for line in result.stderr.splitlines() if "━" not in line]  # less the bars of finished stages
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
