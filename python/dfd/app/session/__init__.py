"""The session of one tab: state, requests, columns, exports."""
