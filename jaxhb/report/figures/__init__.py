"""Answers as figures, readable without colour. Answers go in; specifications come out,
for plotly.js or drawn by matplotlib.
"""
