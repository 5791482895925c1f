"""Scenes as workbooks of spreadsheets: an .xlsx file goes in and the content of a scene
comes out, and the other way round.
"""
