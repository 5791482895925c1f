"""Checks of a train as a whole: sentences on what is wrong before it is built, notes on
what is allowed but far from usual.
"""
