"""Process many shapes in a batch: run chosen steps, such as distillation, and transfer edits to every shape."""
