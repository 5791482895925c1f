"""Answers as text, and the plain numbers and rows behind it. Answers go in; sentences,
tables and records come out.
"""
