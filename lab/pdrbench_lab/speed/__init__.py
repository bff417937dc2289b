"""Speed, in the laboratory."""
