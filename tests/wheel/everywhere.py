"""Build and repair the wheel, and test it in a fresh environment of every Python ≥ 3.11 on this machine.

`python tests/wheel/everywhere.py [FOLDER]` writes the wheel to FOLDER. Each environment contains the wheel and the
packages of `ALONE`, without torch. For the newest Python that torch supports, the test is repeated with torch.
"""

import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
ALONE = ["numpy", "nanobind-backend", "safetensors"]
OLDEST = (3, 11)


def main(folder: Path) -> int:
    """Return the number of environments in which the wheel fails; 1 if there is no environment."""
    wheel = repaired(folder)
    print(f"{wheel.name}: {wheel.stat().st_size / 1e6:.1f} MB", flush=True)
    found = sorted(pythons().items(), reverse=True)
    failed = 0
    torch_tried = False
    for version, python in found:
        with tempfile.TemporaryDirectory() as place:
            environment = Path(place)
            run(python, "-m", "venv", environment)
            inside = environment / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
            install(inside, *ALONE)
            install(inside, "--no-deps", wheel)
            passed = smoke(inside)
            if not torch_tried and install(inside, "torch", wanted=False):
                torch_tried = True
                passed = smoke(inside) and passed
        print(f"Python {'.'.join(map(str, version))}: {'passed' if passed else 'FAILED'}", flush=True)
        failed += not passed
    return failed if found else 1


def repaired(folder: Path, source: Path = ROOT) -> Path:
    """Build the wheel of `source` into `folder` and return its path.

    On Linux, auditwheel sets the tag of supported systems.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as place:
        run(sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "-c", "constraints.txt", "-w", place, source)
        (built,) = Path(place).glob("*.whl")
        if not sys.platform.startswith("linux"):
            return built.rename(folder / built.name)
        # The wheel contains no OpenMP runtime: torch and the kernels must share one, from torch or the system.
        run(sys.executable, "-m", "auditwheel", "repair", "--exclude", "libgomp.so.1", "-w", place + "/repaired", built)
        (whole,) = Path(place, "repaired").glob("*.whl")
        target = folder / whole.name
        target.write_bytes(whole.read_bytes())
        return target


def pythons() -> dict[tuple[int, int], str]:
    """Return every Python ≥ `OLDEST` on the path and of pyenv, by version."""
    found: dict[tuple[int, int], str] = {}
    for path in candidates():
        done = subprocess.run(
            [path, "-c", "import sys, venv, ensurepip; print(*sys.version_info[:2])"],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode == 0:  # pyenv's commands on the path fail unless their version is selected
            major, minor = map(int, done.stdout.split())
            if (major, minor) >= OLDEST:
                found.setdefault((major, minor), str(path))
    return found


def candidates() -> Iterator[Path]:
    for folder in map(Path, os.get_exec_path()):
        if folder.is_dir():
            yield from sorted(path for path in folder.iterdir() if re.fullmatch(r"python3\.\d+(\.exe)?", path.name))
    root = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
    yield from sorted(root.glob("versions/*/bin/python"))
    yield Path(sys.executable)


def smoke(python: Path, *options: str) -> bool:
    """Run the smoke test in another folder, so that Python imports the installed wheel, not the sources."""
    with tempfile.TemporaryDirectory() as elsewhere:
        bare = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
        command = [python, "-I", ROOT / "tests/wheel/smoke.py", *options]
        return subprocess.run(command, cwd=elsewhere, env=bare, check=False).returncode == 0


def install(python: Path, *what: str | Path, wanted: bool = True) -> bool:
    command = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *what]
    return subprocess.run(command, check=wanted, capture_output=not wanted).returncode == 0


def run(*command: str | Path) -> None:
    subprocess.run(command, cwd=ROOT, check=True)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1] if len(sys.argv) > 1 else ROOT / "dist")))
