"""Transients: a train, its events and a time go in, motions that do not repeat come
out.
"""
