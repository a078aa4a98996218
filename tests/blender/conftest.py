"""Tests under Blender as a Python module, in an environment of its own: `make test-blender` says how."""

from __future__ import annotations

import os
import tempfile

# Before bpy is imported: extensions are installed into here, and nobody's own settings are read.
os.environ.setdefault("BLENDER_USER_RESOURCES", tempfile.mkdtemp(prefix="blender-"))
