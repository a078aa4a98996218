"""`python -m bench.app`: time in Chromium what a user of the app waits for, on the samples.

The table has the times until the page shows a sign, such as a progress bar, a word or the result, and until the result
is there. It needs Node, the client's packages (`npm ci`) and the built page.
"""

import json
import os
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from bench.tables import to_markdown
from dfd.app.options import SAMPLES, SessionOptions
from dfd.app.web.launch import RunningApp

SCRIPT = Path(__file__).with_name("waits.mjs")
BROWSERS = ("chromium", "chromium-browser", "google-chrome")


def waits(sample: str) -> list[dict[str, Any]]:
    """Run the script in Node with a new server, and return the times of all steps on a sample."""
    with tempfile.TemporaryDirectory() as data:
        os.environ["DFD_DATA"] = data
        app = RunningApp(SessionOptions())
        app.start()
        browser = next(filter(None, map(shutil.which, BROWSERS)), "")
        environment = {**os.environ, "DFD_URL": app.url, "DFD_CHROMIUM": browser, "DFD_PATIENCE": "600000"}
        node: dict[str, Any] = {"env": environment, "stdout": subprocess.PIPE, "text": True, "check": True}
        try:
            told = subprocess.run(["node", SCRIPT], input=json.dumps(sample), **node)
        finally:
            app.stop()
    return json.loads(told.stdout)


def main() -> None:
    """Measure, and print a table with all steps on each sample."""
    rows = [[name, each["step"], each["sign"], each["done"], each["task"]] for name in SAMPLES for each in waits(name)]
    print(to_markdown(["sample", "step", "sign, ms", "done, ms", "longest script, ms"], rows, ".0f"))


if __name__ == "__main__":
    main()
