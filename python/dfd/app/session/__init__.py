"""The session of one browser tab: its state, its requests, the preparation of its shape, and its exports."""
