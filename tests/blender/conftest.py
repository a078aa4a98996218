"""Tests of the extension with Blender as a Python module. `make test-blender` runs them in a separate environment."""

import os
import tempfile

# Set before bpy is imported, so that bpy uses this folder instead of the user's settings and extensions.
os.environ.setdefault("BLENDER_USER_RESOURCES", tempfile.mkdtemp(prefix="blender-"))
