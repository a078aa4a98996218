"""What a surface is like: how it hangs together, coarser copies of it, distances along it."""
