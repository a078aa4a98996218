"""Which way is up: what pictures show of it, and on what a shape can stand."""
