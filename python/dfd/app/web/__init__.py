"""The server: who may connect, uploads, and the sessions."""
