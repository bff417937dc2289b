"""Frank2009, in the laboratory."""
