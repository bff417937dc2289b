"""For networks that learn: windows of signals with how far the pedestrian moved."""
