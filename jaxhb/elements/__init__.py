"""Elements of a train, one dataclass for each kind, and the checks of single elements.

Elements hold what the engineer wrote; the checks return sentences on what is wrong.
"""
