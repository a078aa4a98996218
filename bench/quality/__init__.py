"""Are the weights good? Numbers from labelled shapes, beside methods that know no features."""
