"""Tuning by transients: the numbers of a train, or of its events, that make what
happens in a transient small. A train, parameters and objectives go in; a tuned train
and its history come out.
"""
