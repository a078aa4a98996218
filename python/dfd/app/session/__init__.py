"""What one tab does, from its first message to its export."""
