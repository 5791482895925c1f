"""Answers as figures, readable without colour: one specification, which the page shows and matplotlib draws."""
