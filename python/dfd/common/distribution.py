"""The name of the distribution, which pip installs. The name of the import package is always `dfd`."""

DISTRIBUTION = "dfd"  # as in pyproject.toml


def pip_install(extra: str) -> str:
    """Return the command that installs an extra of pyproject.toml, such as "app"."""
    return f'pip install "{DISTRIBUTION}[{extra}]"'
