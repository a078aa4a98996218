"""The app: one shape in a browser's tab, handled through a WebSocket; the server binds, the page draws."""
