"""What a train can be made of: one dataclass for each kind of element, and the checks
of single elements. What the engineer wrote goes in, sentences on what is wrong with it
come out.
"""
