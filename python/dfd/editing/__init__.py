"""What an editing session is made of: handles and their transforms, weights kept by column, undo, the JSON document."""
