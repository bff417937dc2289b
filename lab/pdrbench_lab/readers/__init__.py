"""Readers of recorded sets that only the laboratory plays or fits to."""
