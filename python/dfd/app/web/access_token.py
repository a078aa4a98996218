"""The secret with which a program of this user shows that it may use a server on this machine."""

import os
import re
import secrets
from contextlib import suppress

from dfd.common.files import data_directory

TOKEN = re.compile(r"[\w-]{32}")


def new_token() -> str:
    """Return a random token of 32 characters."""
    return secrets.token_urlsafe(24)


def kept_token() -> str:
    """Return the user's token, from a file that only this user can read, so that the app's address stays the same.

    If the data folder cannot be used, return a new token.
    """
    path = data_directory() / "token"
    try:
        with suppress(FileExistsError):
            path.parent.mkdir(parents=True, exist_ok=True)
            path.touch(0o600, exist_ok=False)
            path.write_text(new_token())
        token = path.read_text()
        private = os.name != "posix" or path.stat().st_mode & 0o077 == 0
        return token if TOKEN.fullmatch(token) and private else new_token()
    except (OSError, ValueError):
        return new_token()
