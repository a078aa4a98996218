"""Batch processing of many shapes: transferring one edit to all of them, and every step from file to table."""
