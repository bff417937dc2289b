"""Papers, in the laboratory."""
