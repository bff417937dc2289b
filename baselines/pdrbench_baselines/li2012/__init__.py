"""Li et al. 2012: a phone's steps and headings in a particle filter that learns the stride of its user."""
