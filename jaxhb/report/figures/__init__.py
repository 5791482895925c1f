"""Answers as pictures, drawn by matplotlib, readable without colour."""
