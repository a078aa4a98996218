"""`python -m tests.fuzz [--seconds N] [--seed N] [TARGET …]`: fuzz targets, each for an equal share of the time.

Each target runs in its own process, and the kernels in one process per instruction set of the machine. Hypothesis
minimizes an input that fails. The input is then written to tests/corpus, where the tests read it. If an input ends the
process, it is written there unchanged. The exit code is the number of targets that failed.
"""

import argparse
import hashlib
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
CORPUS = ROOT / "tests/corpus"
SLOWEST = 20.0  # seconds that one input may take
LONGEST = 400.0  # further seconds of a target to minimize a failing input


def main() -> int:
    """Return the number of targets that failed."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=None, help="equal seeds give equal inputs; by default the time")
    parser.add_argument("--input", type=Path, help=argparse.SUPPRESS)  # for child processes: path of the input
    parser.add_argument("targets", nargs="*")
    given = parser.parse_args()
    sys.path.insert(0, str(ROOT / "tests/python"))
    sys.path.insert(0, str(ROOT / "tests/python/mesh"))
    import dfd._core as _core

    from .targets import TARGETS

    unknown = set(given.targets) - set(TARGETS)
    if unknown:
        parser.error(f"there is no target {', '.join(sorted(unknown))}; there are {', '.join(TARGETS)}")
    seed = int(time.time()) if given.seed is None else given.seed
    if given.input is not None:
        return not fuzz(given.targets[0], given.seconds, seed, given.input)
    runs: list[tuple[str, str | None]] = []
    for name in given.targets or TARGETS:
        runs += [(name, isa) for isa in (_core.instruction_sets() if name == "kernels.json" else (None,))]
    return sum(not survives(name, isa, given.seconds / len(runs), seed) for name, isa in runs)


def survives(name: str, isa: str | None, seconds: float, seed: int) -> bool:
    """Run one target in a child process, and return whether it passed; save an input that ended the process."""
    print(name if isa is None else f"{name} with {isa}", end=": ", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, name)
        options = [f"--seconds={seconds}", f"--seed={seed}", f"--input={path}"]
        command = [sys.executable, "-m", "tests.fuzz", *options, name]
        environment = os.environ if isa is None else {**os.environ, "DFD_ISA": isa}
        try:
            code = subprocess.run(command, cwd=ROOT, env=environment, timeout=seconds + LONGEST).returncode
        except subprocess.TimeoutExpired:
            code = -signal.SIGKILL
        if code < 0:
            print(f"killed by {signal.Signals(-code).name}; kept as {keep(name, path.read_bytes())}", flush=True)
    return code == 0


def keep(name: str, content: bytes) -> Path:
    """Write a failing input to tests/corpus, and return its path."""
    CORPUS.mkdir(exist_ok=True)
    stem, ending = name.split(".")
    kept = CORPUS / f"{stem}-{hashlib.sha256(content).hexdigest()[:12]}.{ending}"
    kept.write_bytes(content)
    return kept


def fuzz(name: str, seconds: float, seed: int, path: Path) -> bool:
    """Run one target for `seconds` and return whether it passed; each input is written to `path`."""
    import hypothesis
    from hypothesis import HealthCheck, Phase, given, settings

    from .targets import TARGETS, run

    strategy, check = TARGETS[name]
    end = time.monotonic() + seconds
    tried = 0
    worst: bytes | None = None
    failure: BaseException | None = None

    def attempt(content: bytes) -> None:
        nonlocal tried, worst, failure
        if time.monotonic() > end and failure is None:
            return
        tried += 1
        path.write_bytes(content)
        began = time.monotonic()
        try:
            run(check, path)
            assert time.monotonic() - began < SLOWEST, "it takes too long"
        except BaseException as error:
            worst, failure = content, error
            raise

    batch = 0
    while time.monotonic() < end and failure is None:
        once = settings(
            max_examples=200,
            deadline=None,
            database=None,
            suppress_health_check=list(HealthCheck),
            phases=[Phase.generate, Phase.shrink],
        )(hypothesis.seed(seed + batch)(given(strategy)(attempt)))
        batch += 1
        try:
            once()
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            failure = failure or error
    if failure is None or worst is None:
        print(f"{tried} inputs, none failed", flush=True)
        return True
    kept = keep(name, worst)
    print(f"{type(failure).__name__} after {tried} inputs: {str(failure)[:300]}; kept as {kept}", flush=True)
    return False


if __name__ == "__main__":
    sys.exit(main())
