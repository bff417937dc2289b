"""The likeliest path through a map: a hidden Markov model over places, lengths of steps and heading errors."""
