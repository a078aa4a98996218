"""The web server of the app: access control, uploads and sessions."""
