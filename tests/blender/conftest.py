"""Tests of the extension with Blender as a Python module. `make test-blender` runs them in a separate environment."""

from __future__ import annotations

import os
import tempfile

# Set before bpy is imported: extensions are installed into this folder, and the user's own settings are not read.
os.environ.setdefault("BLENDER_USER_RESOURCES", tempfile.mkdtemp(prefix="blender-"))
