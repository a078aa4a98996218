"""The name of the distribution, which pip installs. The name of the import package is always `dfd`."""

import json
from importlib.metadata import PackageNotFoundError, distribution

DISTRIBUTION = "dfd"  # as in pyproject.toml


def pip_install(extra: str) -> str:
    """Return the command that adds an extra of pyproject.toml, such as "app", to the installed package.

    A package that came from a folder, a file or a repository names this origin (PEP 610), and pip gets it from there.
    """
    name = f"{DISTRIBUTION}[{extra}]"
    try:
        origin = json.loads(distribution(DISTRIBUTION).read_text("direct_url.json") or "{}")
    except (PackageNotFoundError, ValueError):
        origin = {}
    if "url" not in origin:
        return f'pip install "{name}"'
    if origin.get("dir_info", {}).get("editable"):
        return f'pip install -e "{origin["url"].removeprefix("file://")}[{extra}]"'
    version = origin.get("vcs_info", {})
    tool, commit = (f"{version['vcs']}+", f"@{version['commit_id']}") if version else ("", "")
    return f'pip install "{name} @ {tool}{origin["url"]}{commit}"'


def needs(what: str, extra: str, error: ImportError) -> str:
    """Return the message that `what` needs an extra, because of `error`."""
    return f"{what} needs more packages ({error.name}): {pip_install(extra)}"
