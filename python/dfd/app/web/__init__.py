"""The server: who may connect, uploads, and a process for each tab."""
