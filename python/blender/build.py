"""Build the extension: its files, dfd's wheel and the wheels that it needs inside Blender, in one zip.

python python/blender/build.py FOLDER, with a folder that holds dfd's wheel; the zip goes there too. It serves the
platform and the version of Python that it is built on: Blender 5.0 has Python 3.11.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
# What reads a field, binds and measures along the surface; NumPy is Blender's own.
NEEDED = ("nanobind-backend", "pillow", "safetensors", "scipy", "threadpoolctl", "trimesh")
MANIFEST = "blender_manifest.toml"


def main(folder: Path) -> Path:
    """Return the path of the zip; FileNotFoundError if the folder holds no wheel of dfd."""
    wheels = sorted(folder.glob("dfd-*.whl"), key=lambda path: path.stat().st_mtime)
    if not wheels:
        raise FileNotFoundError(f"{folder} holds no wheel of dfd: `make wheel` makes one")
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
    """The manifest, saying which wheels are beside it."""
    listed = "".join(f'  "./wheels/{name}",\n' for name in names)
    top, tables = (HERE / MANIFEST).read_text().split("\n[", 1)
    return f"{top}wheels = [\n{listed}]\n\n[{tables}"


if __name__ == "__main__":
    print(main(Path(sys.argv[1])))
