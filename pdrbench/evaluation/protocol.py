"""How many walks of an environment are tried before the rest is played."""

TRIED_WALKS = 4  # of an environment; a localizer that declines them all declines it; every mounting is among them
PROBED_WALKS = 2  # of an environment are run with two seeds, to see whether they matter
