"""Answers as text: sentences and tables for the terminal. Answers go in, lines come out."""
