"""Other people's interfaces: the EvAAL API of the IPIN competitions, Minari datasets."""
