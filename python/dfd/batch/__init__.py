"""Processes many shapes in a batch: transfers one edit to all of them, and runs every step from file to table."""
