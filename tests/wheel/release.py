"""Build and check the files of a release: the source distribution, and the wheel of this machine.

`python tests/wheel/release.py FOLDER REPOSITORY` writes both to FOLDER, from the last commit. REPOSITORY is the address
of the repository: links and pictures of the README on the package index lead there. The steps are:

- check that the tree is clean, that the changelog has the version of pyproject.toml, and that a tag of that version
  names no other version
- build the source distribution with the app's page, and the wheel from the source distribution
- check the metadata of both with twine, and test both in fresh environments
"""

import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
import tomllib
from pathlib import Path

from everywhere import ALONE, ROOT, install, repaired, run, smoke

PAGE = Path("python/dfd/app/static")


def main(folder: Path, repository: str) -> None:
    """Build and check all files. Exits with a message at the first step that fails."""
    version = checked_version()
    os.environ["DFD_RELEASE"] = "1"  # the build fails without the page
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    with tempfile.TemporaryDirectory() as place:
        source = Path(place)
        export(source)
        add_address(source, repository, version)
        run(sys.executable, "-m", "build", "--sdist", "--outdir", folder, source)
    [sdist] = folder.glob("*.tar.gz")
    with tarfile.open(sdist) as archive:
        if not any(name.endswith(f"{PAGE.as_posix()}/index.html") for name in archive.getnames()):
            sys.exit(f"{sdist.name} lacks the app's page")
    wheel = repaired(folder, sdist)
    run(sys.executable, "-m", "twine", "check", "--strict", sdist, wheel)
    for file in (wheel, sdist):
        with tempfile.TemporaryDirectory() as place:
            run(sys.executable, "-m", "venv", place)
            inside = Path(place, "Scripts/python.exe" if os.name == "nt" else "bin/python")
            install(inside, *ALONE)
            install(inside, "--no-deps", file)
            if not smoke(inside, "--page"):
                sys.exit(f"{file.name} fails the smoke test")
        print(f"{file.name}: {file.stat().st_size / 1e6:.1f} MB, passed", flush=True)


def checked_version() -> str:
    """Return the version of pyproject.toml; exit with a message if it cannot be released now."""
    version: str = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["version"]
    if subprocess.run(["git", "status", "--porcelain"], cwd=ROOT, capture_output=True, check=True).stdout:
        sys.exit("the tree has changes that are not committed")
    if not re.search(rf"^## \[{re.escape(version)}\]", (ROOT / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE):
        sys.exit(f"CHANGELOG.md has no section [{version}]")
    tag = os.environ.get("GITHUB_REF_NAME", "") if os.environ.get("GITHUB_REF_TYPE") == "tag" else f"v{version}"
    if tag != f"v{version}":
        sys.exit(f"the tag {tag} is not that of version {version} in pyproject.toml")
    return version


def export(source: Path) -> None:
    """Write the files of the last commit and the built page to the folder `source`."""
    archive = source / "commit.tar"
    run("git", "archive", "--output", archive, "HEAD")
    with tarfile.open(archive) as files:
        files.extractall(source, filter="data")
    archive.unlink()
    if not (ROOT / PAGE / "index.html").is_file():
        sys.exit("the app's page is not built: a release needs npm")
    shutil.copytree(ROOT / PAGE, source / PAGE)


def add_address(source: Path, repository: str, version: str) -> None:
    """Write the address of the repository into the README and the metadata of the files in the folder `source`."""
    readme = source / "README.md"
    readme.write_text(with_address(readme.read_text("utf-8"), repository, version), "utf-8")
    metadata = source / "pyproject.toml"
    urls = f'[project.urls]\nRepository = "{repository}"\nChangelog = "{repository}/blob/v{version}/CHANGELOG.md"\n\n'
    metadata.write_text(metadata.read_text("utf-8").replace("[project.scripts]", f"{urls}[project.scripts]"), "utf-8")


def with_address(text: str, repository: str, version: str) -> str:
    """Return a page of Markdown whose relative links and pictures lead to a version in the repository."""

    def absolute(link: re.Match[str]) -> str:
        kind = "raw" if link[1].startswith("!") else "blob"
        return f"{link[1]}({repository}/{kind}/v{version}/{link[2]})"

    return re.sub(r"(!?\[[^\]]*\])\((?!https?:|#)([^)]+)\)", absolute, text)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("give the address: make release REPOSITORY=https://github.com/OWNER/NAME")
    main(Path(sys.argv[1]), sys.argv[2].rstrip("/"))
