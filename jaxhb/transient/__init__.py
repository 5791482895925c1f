"""Transients: motion of a train in time while its speed changes or events disturb it.

Files, from the verb down: ``transient`` (the verb), ``motion`` (the result), ``timeline``
(speed over time, blocks of steps), ``torques`` (torques of a block), ``march`` (steps of
a block), ``weights`` (modes in pairs and the weights of a step).
"""
