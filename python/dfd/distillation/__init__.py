"""What distillation is made of: targets spread along the surface, the descent, runs that are kept and found again."""
