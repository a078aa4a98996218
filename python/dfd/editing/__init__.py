"""Editing sessions: handles with transforms and controls, undo, edit files, and transfer to other shapes."""
