"""Answers as figures, readable without colour. Answers go in; figures come out as plain
dictionaries, or drawn by matplotlib.
"""
