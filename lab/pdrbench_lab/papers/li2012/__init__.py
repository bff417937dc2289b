"""Li2012, in the laboratory."""
