"""The server: access control, uploads and sessions."""
