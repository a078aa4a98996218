"""Tests under Blender as a Python module, in an environment of its own: `make test-blender` says how."""

from __future__ import annotations

import os
import tempfile

# Set before bpy is imported, so that bpy uses this folder instead of the user's settings and extensions.
os.environ.setdefault("BLENDER_USER_RESOURCES", tempfile.mkdtemp(prefix="blender-"))
