"""python -m tests.fuzz [--seconds N] [--seed N] [TARGET …]: each target gets its part of the time.

The kernels are run with every instruction set of the machine, each in a process of its own. An input that fails is
kept, as small as Hypothesis can make it, in tests/corpus under its target's name, where the tests find it from then on.
Exits 1 if anything failed.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
CORPUS = ROOT / "tests/corpus"
SLOWEST = 20.0  # seconds that one input may take


def main() -> int:
    """Return how many targets failed."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=None, help="the same inputs each time, as far as the time goes")
    parser.add_argument("targets", nargs="*")
    given = parser.parse_args()
    sys.path.insert(0, str(ROOT / "tests/python"))
    sys.path.insert(0, str(ROOT / "tests/python/mesh"))
    from dfd import _core

    from .targets import TARGETS

    unknown = set(given.targets) - set(TARGETS)
    if unknown:
        parser.error(f"there is no target {', '.join(sorted(unknown))}; there are {', '.join(TARGETS)}")
    runs = [(name, None) for name in given.targets or TARGETS if name != "kernels.json"]
    if "kernels.json" in (given.targets or TARGETS):
        runs += [("kernels.json", isa) for isa in _core.instruction_sets()]
    chosen = os.environ.get("DFD_FUZZ_ISA_CHILD")
    seed = int(time.time()) if given.seed is None else given.seed
    share = given.seconds / len(runs)
    failed = 0
    for name, isa in runs:
        if isa not in (None, _core.instruction_set()) and chosen is None:
            environment = {**os.environ, "DFD_ISA": isa, "DFD_FUZZ_ISA_CHILD": isa}
            command = [sys.executable, "-m", "tests.fuzz", f"--seconds={share}", f"--seed={seed}", name]
            failed += subprocess.run(command, cwd=ROOT, env=environment, check=False).returncode != 0
        elif chosen in (None, isa):
            failed += not fuzz(name, share, seed, isa)
    return failed


def fuzz(name: str, seconds: float, seed: int, isa: str | None) -> bool:
    """Run one target for `seconds`; say what came of it and whether it held."""
    import hypothesis
    from hypothesis import HealthCheck, Phase, given, settings

    from .targets import TARGETS, run

    strategy, check = TARGETS[name]
    end = time.monotonic() + seconds
    tried = 0
    worst: bytes | None = None
    failure: BaseException | None = None
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, name)

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
    label = name if isa is None else f"{name} with {isa}"
    if failure is None or worst is None:
        print(f"{label}: {tried} inputs, none failed", flush=True)
        return True
    CORPUS.mkdir(exist_ok=True)
    kept = CORPUS / f"{name.split('.')[0]}-{hashlib.sha256(worst).hexdigest()[:12]}.{name.split('.')[1]}"
    kept.write_bytes(worst)
    print(f"{label}: {type(failure).__name__} after {tried} inputs: {str(failure)[:300]}; kept as {kept}", flush=True)
    return False


if __name__ == "__main__":
    sys.exit(main())
