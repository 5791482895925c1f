"""Answers for programs. Answers go in; the contents of JSON, CSV and NetCDF files come
out, which are written whole or not at all.
"""
