"""The neural feature field, and its files."""

import dfd.field.vertex_field  # noqa: F401  # by it `Field.load` reads features of vertices
