"""Run quick tests with the lowest versions that pyproject.toml allows, of its dependencies and of all extras.

`python tests/lowest.py FOLDER` makes an environment in FOLDER. dfd itself and torch, which is large, come from the
environment that runs this file.
"""

import os
import subprocess
import sys
import sysconfig
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
OWN = ("torch", "dfd")  # from the environment that runs this file
# Packages whose tests do not compare recorded numbers or the words of other packages, which depend on versions.
TESTED = (
    *("batch", "common", "distillation", "encoders", "export", "field", "geometry", "mesh", "pictures", "posing"),
    *("samples", "symmetry", "upright", "views", "weights"),
)


def main(folder: Path) -> int:
    """Return the exit code of pytest."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    extras = project["optional-dependencies"]
    wanted = [*project["dependencies"], *(each for extra in extras.values() for each in extra)]
    lowest = [each for each in wanted if not each.startswith(OWN)]
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
        *(ROOT / "tests" / "python" / each for each in TESTED),
        *("-p", "xdist.plugin", f"--numprocesses={os.environ.get('JOBS', '2')}", "--dist=loadfile"),
    ]
    return subprocess.run(command, cwd=ROOT, env=environment, check=False).returncode


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
