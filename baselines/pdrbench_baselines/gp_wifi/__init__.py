"""A radio map that extrapolates: path loss, a Gaussian process, and what was not received."""
