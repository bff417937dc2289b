"""Foot ins, in the laboratory."""
