"""Evaluate, save and cache neural feature fields, and check that a field belongs to a mesh."""

from dfd.field.field import Field
from dfd.field.vertex_field import VertexField

Field._without_network = VertexField  # a module cannot import the subclass of its class
